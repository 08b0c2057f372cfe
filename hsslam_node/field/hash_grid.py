"""Multi-resolution hash grid: trilinear features from one table per level."""

from collections.abc import Sequence

import torch
from torch import Tensor

from hsslam_node.field.layout import FieldLayout

PRIMES = (1, 2654435761, 805459861)
_UINT32 = 0xFFFFFFFF


def hash_grid_features(layout: FieldLayout, tables: Sequence[Tensor], points: Tensor) -> Tensor:
    """Trilinearly interpolated features of all levels, coarsest first.

    Position on level l is (x - low) / longest side * res_l, on all three axes. Points outside the
    cube of the longest side take the value at its border.

    Args:
        layout: resolutions and which levels are dense.
        tables: one [entries, F] per level.
        points: [N, 3] m, world.

    Returns:
        [N, levels * F]

    Source: Müller et al., Instant Neural Graphics Primitives (2022).
    """
    low = torch.as_tensor(layout.bound.low, dtype=points.dtype, device=points.device)
    unit = (points - low) / float(layout.bound.extent_m.max())  # [N, 3]
    levels = [
        _level_features(table, unit * resolution, resolution, dense)
        for table, resolution, dense in zip(
            tables, layout.hash_resolutions, layout.hash_is_dense, strict=True
        )
    ]
    return torch.cat(levels, dim=-1) if levels else points.new_zeros((len(points), 0))


def entry_index(vertex: Tensor, resolution: int, dense: bool, entries: int) -> Tensor:
    """Table index [...] of grid vertices [..., 3] int64: dense or XOR-hashed."""
    x, y, z = vertex.unbind(-1)
    if dense:
        side = resolution + 1
        return x + side * y + side * side * z
    products = [(v * prime) & _UINT32 for v, prime in zip((x, y, z), PRIMES, strict=True)]
    return (products[0] ^ products[1] ^ products[2]) & (entries - 1)


def _level_features(table: Tensor, position: Tensor, resolution: int, dense: bool) -> Tensor:
    """Features [N, F] of one level at grid positions [N, 3] (in cells)."""
    position = position.clamp(0.0, float(resolution))
    cell = position.detach().floor().clamp(max=resolution - 1)  # [N, 3]
    fraction = position - cell
    cell = cell.long()
    out = torch.zeros(len(position), table.shape[1], dtype=table.dtype, device=table.device)
    for corner in range(8):
        offset = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2 & 1], device=cell.device)
        weight = torch.where(offset.bool(), fraction, 1.0 - fraction).prod(dim=-1)  # [N]
        index = entry_index(cell + offset, resolution, dense, len(table))
        out = out + weight[:, None] * table[index]
    return out
