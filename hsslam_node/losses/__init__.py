"""The loss terms of mapping and bundle adjustment, as differentiable PyTorch."""
