"""Sampling of rays, casting of rays onto the scene model's surface, and depth images of meshes."""
