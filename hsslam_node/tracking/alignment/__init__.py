"""Alignment of a frame to the map, and to the surface and image of a keyframe."""
