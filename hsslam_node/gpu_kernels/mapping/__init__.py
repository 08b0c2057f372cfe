"""A step of the map optimiser on the GPU: rays, rendering, losses, Adam."""
