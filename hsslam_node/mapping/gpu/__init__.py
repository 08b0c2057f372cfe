"""The optimiser of the scene model on the GPU: twin of `mapping/map_optimiser.py`."""
