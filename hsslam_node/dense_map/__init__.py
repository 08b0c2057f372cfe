"""A map that can be asked: distances, rays, free space, views, its mesh and its keyframes."""
