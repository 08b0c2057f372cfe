"""The two decoders: bias-free two-layer perceptrons over the encodings."""

import torch
from torch import Tensor


def decode_geometry(features: Tensor, W1: Tensor, W2: Tensor) -> tuple[Tensor, Tensor]:
    """Signed distance and geometry feature.

    Args:
        features: [N, geometry_input_width]: hash, coarse + fine planes, one-blob.
        W1: [geometry_input_width, hidden].
        W2: [hidden, 1 + geometry_feature_width].

    Returns:
        SDF [N] in units of the truncation, -1..1 (tanh), and geometry feature g [N, 15].
    """
    out = torch.relu(features @ W1) @ W2
    return torch.tanh(out[:, 0]), out[:, 1:]


def decode_color(features: Tensor, W1: Tensor, W2: Tensor) -> Tensor:
    """Colour [N, 3], 0..1 (sigmoid), of features [N, color_input_width]: planes, one-blob, g."""
    return torch.sigmoid(torch.relu(features @ W1) @ W2)
