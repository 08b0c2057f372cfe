"""What is known of a voxel, and its blocks; a file of its own, as the wire and kernels of numba share it."""

UNKNOWN, FREE, OCCUPIED = 0, 1, 2
BLOCK_SIDE = 16  # voxels
NOT_KNOWN_MM = -32768  # in the place of a distance; farther from all of them than any tolerance
