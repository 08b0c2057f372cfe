"""Reference of `kernels/field/hash_grid.py`.

Multi-resolution hash grid: trilinear features from one table per level.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from hsslam_node.map.layout import FieldLayout

PRIMES = (1, 2654435761, 805459861)
_UINT32 = 0xFFFFFFFF


def hash_grid_features(layout: FieldLayout, tables: Sequence[Tensor], points: Tensor) -> Tensor:
    """Trilinearly interpolated features of all levels, coarsest first.

    Position on level l is (x - low) / longest side * res_l, on all three axes, of the first bound.
    Points beyond the vertices of a level take the value at its border.

    Args:
        layout: resolutions, vertices and which levels are dense.
        tables: one [entries, F] per level.
        points: [N, 3] m, world.

    Returns:
        [N, levels * F]

    Source: Müller et al., Instant Neural Graphics Primitives (2022).
    """
    low = torch.as_tensor(layout.lattice.low, dtype=points.dtype, device=points.device)
    unit = (points - low) / float(layout.lattice.extent_m.max())  # [N, 3]
    levels = [
        _level_features(layout, level, table, unit * resolution)
        for level, (table, resolution) in enumerate(
            zip(tables, layout.hash_resolutions, strict=True)
        )
    ]
    return torch.cat(levels, dim=-1) if levels else points.new_zeros((len(points), 0))


def dense_index(vertex: Tensor, first: Sequence[int], count: Sequence[int]) -> Tensor:
    """Table index [...] of vertices [..., 3] int64 of a dense level, x fastest.

    `first` and `count` are the first vertex and the number of vertices along x, y, z.
    """
    x, y, z = (v - f for v, f in zip(vertex.unbind(-1), first, strict=True))
    return x + count[0] * (y + count[1] * z)


def hashed_index(vertex: Tensor, entries: int) -> Tensor:
    """Table index [...] of vertices [..., 3] int64, also negative ones; `entries` a power of two."""
    products = [(v * prime) & _UINT32 for v, prime in zip(vertex.unbind(-1), PRIMES, strict=True)]
    return (products[0] ^ products[1] ^ products[2]) & (entries - 1)


def _level_features(layout: FieldLayout, level: int, table: Tensor, position: Tensor) -> Tensor:
    """Features [N, F] of one level at grid positions [N, 3] (in cells)."""
    first, count = (n.tolist() for n in layout.hash_vertices(level))
    last = position.new_tensor(first) + position.new_tensor(count) - 1
    position = position.clamp(position.new_tensor(first), last)
    cell = position.detach().floor().clamp(max=last - 1)  # [N, 3]
    fraction = position - cell
    cell = cell.long()
    out = torch.zeros(len(position), table.shape[1], dtype=table.dtype, device=table.device)
    for corner in range(8):
        offset = torch.tensor([corner & 1, corner >> 1 & 1, corner >> 2 & 1], device=cell.device)
        weight = torch.where(offset.bool(), fraction, 1.0 - fraction).prod(dim=-1)  # [N]
        if layout.hash_is_dense[level]:
            index = dense_index(cell + offset, first, count)
        else:
            index = hashed_index(cell + offset, len(table))
        out = out + weight[:, None] * table[index]
    return out
