"""Fused CPU kernels (numba, one thread). Each file names its twin in `gpu_kernels/` and its reference."""
