"""The parameter layout in the form that kernels take: a named tuple of small arrays.

Twin: `gpu_kernels/field/layout.py`.
"""

from typing import NamedTuple

import numpy as np

from hsslam_node.map.layout import PLANE_AXES, FieldLayout

PLANE_SETS = ("geometry_coarse", "geometry_fine", "appearance_coarse", "appearance_fine")
BLOCK = 256  # points of a pass: their activations stay in the L2 cache


class KernelLayout(NamedTuple):
    """Offsets and resolutions of a `FieldLayout`; offsets count floats from the start of params."""

    low: np.ndarray  # [3] float32 m, world
    high: np.ndarray  # [3] float32 m, world
    origin: np.ndarray  # [3] float32 m, world: vertex 0; positions count from it
    channels: int  # of the planes; 0: none
    plane_offset: np.ndarray  # [4, 3] int64, of vertex (0, 0) of the xy, xz and yz planes
    plane_first: np.ndarray  # [4, 3] int64, first vertex along x, y, z
    plane_count: np.ndarray  # [4, 3] int64, vertices along x, y, z
    plane_inv_cell: np.ndarray  # [4] float32 1/m
    hash_offset: np.ndarray  # [L] int64, of each table; none: no hash grid
    hash_first: np.ndarray  # [L, 3] int64, first vertex along x, y, z
    hash_count: np.ndarray  # [L, 3] int64, vertices along x, y, z
    hash_scale: np.ndarray  # [L] float32 cells per m
    hash_mask: np.ndarray  # [L] int64, entries - 1; 0 if the level is dense
    inv_extent: np.ndarray  # [3] float32 1/m, one-blob normalisation
    blob_rows: int  # rows of the one-blob encoding in the decoders' first layers: 48, or 0
    geometry_W1: int
    geometry_W2: int
    color_W1: int
    color_W2: int
    log_beta: int
    parameter_count: int


def levels_of(layout: KernelLayout, levels: slice) -> KernelLayout:
    """The layout with only these levels of the hash grid."""
    names = ("hash_offset", "hash_first", "hash_count", "hash_scale", "hash_mask")
    return layout._replace(**{name: getattr(layout, name)[levels] for name in names})


def kernel_layout(layout: FieldLayout) -> KernelLayout:
    """Flatten a `FieldLayout` for the kernels."""
    blocks = layout.blocks
    config = layout.config
    cells = (
        config.coarse_cell_m,
        config.geometry_fine_cell_m,
        config.coarse_cell_m,
        config.appearance_fine_cell_m,
    )
    C = config.plane_channels
    offset = np.zeros((4, 3), np.int64)
    first, count = np.zeros((4, 3), np.int64), np.zeros((4, 3), np.int64)
    for s, (name, cell_m) in enumerate(zip(PLANE_SETS, cells, strict=True)):
        first[s], count[s] = layout.plane_vertices(cell_m)
        for p, axes in enumerate(("xy", "xz", "yz")):
            u, v = PLANE_AXES[p]
            block = blocks[f"{name}.{axes}"]
            offset[s, p] = block.offset - (first[s, v] * count[s, u] + first[s, u]) * C
    levels = range(config.hash_tables)
    hashes = [blocks[f"hash.{level:02d}"] for level in levels]
    vertices = np.array([layout.hash_vertices(level) for level in levels], np.int64)
    vertices = vertices.reshape(len(hashes), 2, 3)
    longest = float(layout.lattice.extent_m.max())
    return KernelLayout(
        low=np.asarray(layout.bound.low, np.float32),
        high=np.asarray(layout.bound.high, np.float32),
        origin=np.asarray(layout.lattice.low, np.float32),
        channels=C,
        plane_offset=offset,
        plane_first=first,
        plane_count=count,
        plane_inv_cell=np.asarray([1.0 / c for c in cells], np.float32),
        hash_offset=np.asarray([b.offset for b in hashes], np.int64),
        hash_first=np.ascontiguousarray(vertices[:, 0]),
        hash_count=np.ascontiguousarray(vertices[:, 1]),
        hash_scale=np.asarray([r / longest for r in layout.hash_resolutions], np.float32),
        hash_mask=np.asarray(
            [
                0 if dense else entries - 1
                for dense, entries in zip(layout.hash_is_dense, layout.hash_entries, strict=True)
            ],
            np.int64,
        ),
        inv_extent=(1.0 / layout.lattice.extent_m).astype(np.float32),
        blob_rows=config.oneblob_width,
        geometry_W1=blocks["geometry_decoder.W1"].offset,
        geometry_W2=blocks["geometry_decoder.W2"].offset,
        color_W1=blocks["color_decoder.W1"].offset,
        color_W2=blocks["color_decoder.W2"].offset,
        log_beta=blocks["log_beta"].offset,
        parameter_count=layout.parameter_count,
    )
