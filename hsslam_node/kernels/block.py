"""How many points a pass of the kernels takes."""

BLOCK = 256  # activations of so many points stay in the L2 cache
