"""Fused CPU kernels (numba, one thread); every one has a plain PyTorch twin that it is tested against."""
