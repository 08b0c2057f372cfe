"""What is known of a voxel; a file of its own as kernels and classes share it."""

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
