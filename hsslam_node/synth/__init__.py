"""The renderer of the built-in scenes: what stands in them, its textures, its images."""
