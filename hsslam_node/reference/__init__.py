"""Model, rendering and losses in plain PyTorch: what tests compare the kernels with. No process runs this."""
