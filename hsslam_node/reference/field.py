"""Reference of `kernels/field/forward.py`, `kernels/field/backward.py`, `kernels/field/pose_backward.py`,
`kernels/field/decoder.py` and `kernels/field/sdf_query.py`.

The scene model as a differentiable PyTorch module: encodings, then two bias-free two-layer perceptrons.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.reference.encodings import oneblob_of_points, tri_plane_features
from hsslam_node.reference.hash_grid import hash_grid_features


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


_AXES = ("xy", "xz", "yz")


@dataclass(frozen=True)
class FieldOutput:
    """The field at N points."""

    sdf: Tensor  # [N] units of the truncation, -1..1, positive in free space
    color: Tensor  # [N, 3] RGB 0..1
    hash_feature: Tensor  # [N, levels * 2]
    inside: Tensor  # [N] bool, within the bound; mask everything else out of every loss


class HybridField(nn.Module):
    """Hash grid, tri-planes and one-blob with two decoders over one flat parameter vector.

    Any device and floating type; `float64` for finite differences. Paper, section III-A.

    Args:
        layout: where each block lies in the parameters.
        params: [P] flat parameters, or None for `initial_parameters(layout, seed=0)`.
    """

    def __init__(self, layout: FieldLayout, params: Tensor | None = None) -> None:
        super().__init__()
        if params is None:
            params = torch.from_numpy(initial_parameters(layout, seed=0))
        if params.shape != (layout.parameter_count,):
            raise ValueError(f"params {list(params.shape)}: expected [{layout.parameter_count}]")
        self.layout = layout
        self.params = nn.Parameter(params)

    def forward(self, points: Tensor) -> FieldOutput:
        """Signed distance and colour of points [N, 3] m, world."""
        hash_feature = self.hash_feature(points)
        blob = self._blob(points)
        sdf, g = self._geometry(points, hash_feature, blob)
        fine_m = self.layout.config.appearance_fine_cell_m
        appearance = self._planes("appearance", points, fine_m)
        features = torch.cat([appearance, blob, g], dim=-1)
        color = decode_color(
            features, self.block("color_decoder.W1"), self.block("color_decoder.W2")
        )
        return FieldOutput(sdf, color, hash_feature, self.inside(points))

    def sdf(self, points: Tensor) -> Tensor:
        """Signed distance [N], units of the truncation, of points [N, 3] m; no colour."""
        return self._geometry(points, self.hash_feature(points), self._blob(points))[0]

    def hash_feature(self, points: Tensor) -> Tensor:
        """Hash-grid feature [N, levels * 2] of points [N, 3] m (the smoothness loss acts on it)."""
        count = self.layout.config.hash_tables
        tables = [self.block(f"hash.{table:02d}") for table in range(count)]
        return hash_grid_features(self.layout, tables, points)

    def inside(self, points: Tensor) -> Tensor:
        """Mask [N] of points [N, 3] m within the bound, borders included."""
        low, high = (points.new_tensor(c) for c in (self.layout.bound.low, self.layout.bound.high))
        return ((points >= low) & (points <= high)).all(dim=-1)

    @property
    def beta(self) -> Tensor:
        """Sharpness of the density, scalar; stored as its logarithm, so always positive."""
        return self.block("log_beta")[0].exp()

    def block(self, name: str) -> Tensor:
        """One block of the parameters as a differentiable view."""
        block = self.layout.blocks[name]
        return self.params[block.offset : block.offset + block.size].view(block.shape)

    def _blob(self, points: Tensor) -> Tensor:
        """One-blob encoding [N, 48]; [N, 0] if it is off."""
        if self.layout.config.oneblob_bins == 0:
            return points.new_zeros((len(points), 0))
        return oneblob_of_points(points, self._corner("low"), self._corner("high"))

    def _geometry(
        self, points: Tensor, hash_feature: Tensor, blob: Tensor
    ) -> tuple[Tensor, Tensor]:
        planes = self._planes("geometry", points, self.layout.config.geometry_fine_cell_m)
        features = torch.cat([hash_feature, planes, blob], dim=-1)
        W1, W2 = self.block("geometry_decoder.W1"), self.block("geometry_decoder.W2")
        return decode_geometry(features, W1, W2)

    def _planes(self, kind: str, points: Tensor, fine_cell_m: float) -> Tensor:
        """Coarse and fine tri-plane features [N, 2 C], concatenated."""
        low = self._corner("low")
        cells = (("coarse", self.layout.config.coarse_cell_m), ("fine", fine_cell_m))
        levels = []
        for level, cell_m in cells:
            planes = [self.block(f"{kind}_{level}.{axes}") for axes in _AXES]
            first = torch.as_tensor(self.layout.plane_vertices(cell_m)[0]).to(points)
            levels.append(tri_plane_features(planes, points, low, cell_m, first))
        return torch.cat(levels, dim=-1)

    def _corner(self, which: str) -> Tensor:
        """Corner [3] of the first bound, `low` or `high`."""
        return self.params.new_tensor(getattr(self.layout.lattice, which))
