"""Grids and distances to messages."""

from typing import Any, NamedTuple

import numpy as np

from hsslam_node.distance.distance_blocks import Blocks
from hsslam_node.distance.grid_map import GridMap
from hsslam_node.distance.states import NOT_KNOWN_MM
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.geometry.se3 import inverse
from hsslam_proto.distance.messages import Esdf, EsdfBlocks, Grid
from hsslam_proto.messages import Pose
from hsslam_proto.pose_codec import wire_pose


class Band(NamedTuple):
    """Range of heights above the floor that a grid covers, and the source of the direction up."""

    low_m: float
    high_m: float
    up_by: str


class Lattice(NamedTuple):
    """Voxels and pose of the blocks of distances."""

    grid: VoxelGrid
    T_grid_world: np.ndarray  # [4, 4]
    series: int
    revision: int


def grid_message(grid: GridMap, band: Band, pose: Pose) -> Grid:
    """The cells as of the frame of this pose."""
    return Grid(**_raster(grid, band, pose), cells=_bytes(grid.cells, np.int8))


def esdf_message(grid: GridMap, band: Band, pose: Pose) -> Esdf:
    """Distances in the plane of the cells as of the frame of this pose; takes some 2 ms."""
    mm = 1000 * grid.distances_m()
    known = np.where(np.isnan(mm), NOT_KNOWN_MM, np.rint(mm))
    return Esdf(**_raster(grid, band, pose), distance_mm=_bytes(known, "<i2"))


def blocks_message(blocks: Blocks, lattice: Lattice, pose: Pose) -> EsdfBlocks:
    """Blocks of distances as of the frame of this pose."""
    t, q = wire_pose(inverse(lattice.T_grid_world))
    return EsdfBlocks(
        index=pose.index,
        stamp_ns=pose.stamp_ns,
        series=lattice.series,
        revision=lattice.revision,
        t=t,
        q=q,
        voxel_m=lattice.grid.voxel_m,
        first=lattice.grid.first,
        voxels=lattice.grid.shape,
        blocks=_bytes(blocks.places, "<i4"),
        distance_mm=_bytes(blocks.distance_mm, "<i2"),
        map_epoch=pose.map_epoch,
    )


def _raster(grid: GridMap, band: Band, pose: Pose) -> dict[str, Any]:
    t, q = wire_pose(inverse(grid.T_floor_world) @ grid.T_floor_grid)
    height, width = grid.cells.shape
    return {
        "index": pose.index,
        "stamp_ns": pose.stamp_ns,
        "source_stamp_ns": pose.source_stamp_ns,
        "t": t,
        "q": q,
        "resolution_m": grid.resolution_m,
        "width": width,
        "height": height,
        "low_m": band.low_m,
        "high_m": band.high_m,
        "up_by": band.up_by,
        "map_epoch": pose.map_epoch,
    }


def _bytes(array: np.ndarray, dtype: object) -> memoryview:
    return np.ascontiguousarray(array, np.dtype(dtype)).reshape(-1).view(np.uint8).data  # type: ignore[arg-type]
