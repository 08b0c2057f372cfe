"""The device that computes the scene model, CPU or GPU, and what a GPU needs besides kernels."""
