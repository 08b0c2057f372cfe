"""A step of the map optimiser on the CPU: rays, rendering, losses, Adam."""
