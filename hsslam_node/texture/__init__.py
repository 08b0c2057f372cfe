"""Textures a mesh with the images of keyframes."""
