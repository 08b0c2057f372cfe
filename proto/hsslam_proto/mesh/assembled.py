"""Assembles the live mesh from messages of its blocks: for export, requests and viewers."""

import threading
from itertools import islice
from typing import NamedTuple

import numpy as np

from hsslam_node.meshing.block_grid import edges_in_half_cells
from hsslam_proto.block_revisions import Block, BlockRevisions
from hsslam_proto.mesh.codec import BlockLattice, Triangles, block_triangles
from hsslam_proto.mesh.messages import MeshBlocks

_SNAP_CELLS = 1e-2  # a vertex this close to a lattice vertex snaps to it


class BlockNews(NamedTuple):
    """Blocks to draw; None: the block has no surface any more. `anew`: first remove all blocks drawn before.

    `map_epoch`: map epoch of all blocks; -1: no block yet.
    """

    anew: bool
    blocks: dict[Block, Triangles | None]
    map_epoch: int


class PendingBlocks:
    """Changed blocks that are not drawn yet, the newest version of each; one thread adds, another takes.

    Memory is bounded by the surface, also if no thread takes.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._revisions = BlockRevisions()
        self._anew = False
        self._blocks: dict[Block, Triangles | None] = {}

    def __bool__(self) -> bool:
        return self._anew or bool(self._blocks)

    def add(self, message: MeshBlocks) -> None:
        """Take in one message."""
        with self._lock:
            news = _news(self._revisions, message)
            if self._revisions.begins_anew:
                self._blocks, self._anew = {}, True
            self._blocks.update(news)

    def take(self, most: int | None = None) -> BlockNews:
        """Remove and return at most `most` (None: all) of the waiting blocks, the oldest first."""
        with self._lock:
            taken = dict(islice(self._blocks.items(), most))
            for block in taken:
                del self._blocks[block]
            was_anew, self._anew = self._anew, False
            return BlockNews(was_anew, taken, self._revisions.map_epoch)

    def forget_before(self, map_epoch: int) -> None:
        """Drop blocks of earlier map epochs."""
        with self._lock:
            if self._revisions.begin(map_epoch):
                self._blocks, self._anew = {}, False


class AssembledMesh:
    """All blocks of the live mesh after the messages so far."""

    def __init__(self) -> None:
        self.map_version = 0
        self.map_epoch = 0
        self._revisions = BlockRevisions()
        self._blocks: dict[Block, Triangles] = {}
        self._lattice = BlockLattice(1.0, 1.0)

    def add(self, message: MeshBlocks) -> None:
        """Take in one message."""
        news = _news(self._revisions, message)
        if self._revisions.begins_anew:
            self.map_version = 0
            self._blocks.clear()
        for block, triangles in news.items():
            if triangles is None:
                self._blocks.pop(block, None)
            else:
                self._blocks[block] = triangles
        if news:
            self.map_version = max(self.map_version, message.map_version)
            self.map_epoch = message.map_epoch
            self._lattice = BlockLattice(message.voxel_m, message.block_m)

    def whole(self) -> Triangles | None:
        """All blocks as one mesh; vertices on the same edge of the lattice are merged. None: no block."""
        if not self._blocks:
            return None
        parts = [self._blocks[block] for block in sorted(self._blocks)]
        offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = np.concatenate([p.faces + o for p, o in zip(parts, offsets, strict=False)])
        vertices = np.concatenate([part.vertices for part in parts])
        colors = np.concatenate([part.colors for part in parts])
        cells = vertices.astype(np.float64) / self._lattice.voxel_m
        edges = edges_in_half_cells(cells, _SNAP_CELLS)
        _, first, inverse = np.unique(edges, axis=0, return_index=True, return_inverse=True)
        a, b, c = (faces := inverse.reshape(-1)[faces]).T
        faces = faces[(a != b) & (b != c) & (c != a)].astype(np.uint32)
        return Triangles(vertices[first], faces, colors[first])


def _news(revisions: BlockRevisions, message: MeshBlocks) -> dict[Block, Triangles | None]:
    """The new blocks of a message; None: the block has no surface any more."""
    blocks = block_triangles(message)
    return revisions.news(message.map_epoch, message.series, message.revision, blocks)
