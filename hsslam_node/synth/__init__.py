"""The built-in scenes: their parts, their textures and their images."""
