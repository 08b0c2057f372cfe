"""The parameter layout in the form that kernels take: a named tuple of small arrays."""

from typing import NamedTuple

import numpy as np

from hsslam_node.field.layout import PLANE_AXES, FieldLayout

PLANE_SETS = ("geometry_coarse", "geometry_fine", "appearance_coarse", "appearance_fine")


class KernelLayout(NamedTuple):
    """Offsets and resolutions of a `FieldLayout`; offsets count floats from the start of params."""

    low: np.ndarray  # [3] float32 m, world
    high: np.ndarray  # [3] float32 m, world
    channels: int  # of the planes; 0: none
    plane_axes: np.ndarray  # [3, 2] int64, world axes (u, v) of xy, xz, yz
    plane_offset: np.ndarray  # [4, 3] int64
    plane_resolution: np.ndarray  # [4, 3, 2] int64, vertices (u, v)
    plane_inv_cell: np.ndarray  # [4] float32 1/m
    hash_offset: np.ndarray  # [L] int64, of each table; none: no hash grid
    hash_resolution: np.ndarray  # [L] int64
    hash_scale: np.ndarray  # [L] float32 cells per m
    hash_mask: np.ndarray  # [L] int64, entries - 1; 0 where the level is dense
    inv_extent: np.ndarray  # [3] float32 1/m, one-blob normalisation
    blob_rows: int  # rows of the one-blob encoding in the decoders' first layers: 48, or 0
    geometry_W1: int
    geometry_W2: int
    color_W1: int
    color_W2: int
    log_beta: int
    parameter_count: int


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
    offset = np.zeros((4, 3), np.int64)
    resolution = np.zeros((4, 3, 2), np.int64)
    for s, name in enumerate(PLANE_SETS):
        for p, axes in enumerate(("xy", "xz", "yz")):
            block = blocks[f"{name}.{axes}"]
            offset[s, p] = block.offset
            resolution[s, p] = block.shape[1], block.shape[0]
    hashes = [blocks[f"hash.{level:02d}"] for level in range(config.hash_tables)]
    longest = float(layout.bound.extent_m.max())
    return KernelLayout(
        low=np.asarray(layout.bound.low, np.float32),
        high=np.asarray(layout.bound.high, np.float32),
        channels=config.plane_channels,
        plane_axes=np.asarray(PLANE_AXES, np.int64),
        plane_offset=offset,
        plane_resolution=resolution,
        plane_inv_cell=np.asarray([1.0 / c for c in cells], np.float32),
        hash_offset=np.asarray([b.offset for b in hashes], np.int64),
        hash_resolution=np.asarray(layout.hash_resolutions, np.int64),
        hash_scale=np.asarray([r / longest for r in layout.hash_resolutions], np.float32),
        hash_mask=np.asarray(
            [
                0 if dense else entries - 1
                for dense, entries in zip(layout.hash_is_dense, layout.hash_entries, strict=True)
            ],
            np.int64,
        ),
        inv_extent=(1.0 / layout.bound.extent_m).astype(np.float32),
        blob_rows=config.oneblob_width,
        geometry_W1=blocks["geometry_decoder.W1"].offset,
        geometry_W2=blocks["geometry_decoder.W2"].offset,
        color_W1=blocks["color_decoder.W1"].offset,
        color_W2=blocks["color_decoder.W2"].offset,
        log_beta=blocks["log_beta"].offset,
        parameter_count=layout.parameter_count,
    )
