"""Assembles the distances of a window from messages of its blocks: for subscribers."""

import numpy as np

from hsslam_node.distance.states import BLOCK_SIDE as SIDE
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.geometry.se3 import inverse
from hsslam_proto.block_revisions import Block, BlockRevisions
from hsslam_proto.distance.arrays import T_world_raster, blocks_m
from hsslam_proto.distance.messages import EsdfBlocks


class AssembledDistances:
    """All blocks of the newest window after the messages so far, which may come in any order."""

    def __init__(self) -> None:
        self._revisions = BlockRevisions()
        self._newest: EsdfBlocks | None = None
        self._blocks: dict[Block, np.ndarray] = {}

    def add(self, message: EsdfBlocks) -> None:
        """Take in one message."""
        map_epoch, series, revision = message.map_epoch, message.series, message.revision
        if self._revisions.is_past(map_epoch, series):
            return
        news = self._revisions.news(map_epoch, series, revision, blocks_m(message))
        if self._revisions.begins_anew:
            self._newest = None
            self._blocks.clear()
        self._blocks.update(news)
        if self._newest is None or revision >= self._newest.revision:
            self._newest = message
        self._forget_outside(self._newest)

    def whole(self) -> tuple[VoxelGrid, np.ndarray, np.ndarray] | None:
        """The newest window: voxels, distances [nx, ny, nz] float32 m (nan: unknown), T_grid_world [4, 4].

        None: no message yet.
        """
        message = self._newest
        if message is None:
            return None
        grid = VoxelGrid(message.voxel_m, message.first, message.voxels)
        distance_m = np.full(grid.shape[::-1], np.nan, np.float32)
        for place, values in self._blocks.items():
            begin = SIDE * np.array(place[::-1]) - grid.first[::-1]
            low, high = np.maximum(begin, 0), np.minimum(begin + SIDE, distance_m.shape)
            there = tuple(slice(*ends) for ends in np.stack([low, high], 1))
            here = tuple(slice(*ends) for ends in np.stack([low, high], 1) - begin[:, None])
            distance_m[there] = values[here]
        return grid, distance_m.T, inverse(T_world_raster(message))

    def _forget_outside(self, newest: EsdfBlocks) -> None:
        low = np.array(newest.first) // SIDE
        high = (np.array(newest.first) + newest.voxels - 1) // SIDE
        outside = [place for place in self._blocks if ((place < low) | (place > high)).any()]
        self._revisions.forget(outside)
        for place in outside:
            del self._blocks[place]
