"""A frame is aligned to the map, to the surface of a keyframe and to its image."""
