"""Reads messages of grids and distances as arrays; apart from `compose`, which needs compiled kernels."""

import numpy as np

from hsslam_node.distance.states import BLOCK_SIDE as SIDE
from hsslam_node.distance.states import NOT_KNOWN_MM
from hsslam_node.geometry.se3 import transform
from hsslam_proto.block_revisions import Block
from hsslam_proto.distance.messages import Esdf, EsdfBlocks, Grid, Raster


def cells_of(message: Grid) -> np.ndarray:
    """Cells [height, width] int8; a copy."""
    return np.frombuffer(message.cells, np.int8).reshape(message.height, message.width).copy()


def slice_m(message: Esdf) -> np.ndarray:
    """Distances [height, width] float32 m; nan: unknown."""
    mm = np.frombuffer(message.distance_mm, "<i2").reshape(message.height, message.width)
    return _metres(mm)


def blocks_m(message: EsdfBlocks) -> dict[Block, np.ndarray]:
    """Distances [16, 16, 16] (z, y, x) float32 m of each block; nan: unknown."""
    places = np.frombuffer(message.blocks, "<i4").reshape(-1, 3).tolist()
    mm = np.frombuffer(message.distance_mm, "<i2").reshape(-1, SIDE, SIDE, SIDE)
    return {(x, y, z): _metres(values) for (x, y, z), values in zip(places, mm, strict=True)}


def T_world_raster(message: Raster | EsdfBlocks) -> np.ndarray:
    """From the frame whose origin is the corner of cell or voxel 0 to the world, [4, 4]."""
    return transform(np.array(message.t), np.array(message.q))


def _metres(mm: np.ndarray) -> np.ndarray:
    metres = mm.astype(np.float32) / np.float32(1000)
    metres[mm == NOT_KNOWN_MM] = np.nan
    return metres
