"""The live mesh put together from messages of its blocks: for export, requests and viewers."""

import threading
from itertools import islice
from typing import NamedTuple

import numpy as np

from hsslam_proto.mesh.blocks_message import MeshBlocks
from hsslam_proto.mesh.codec import Block, BlockLattice, Triangles, block_triangles

_NONE_YET = (-1, -1)
_SNAP_CELLS = 1e-2  # vertices this close to a lattice vertex are that vertex


class BlockRevisions:
    """Says which blocks of a message are news, in whatever order messages come; memory is that of the blocks.

    `begins_anew`: whether blocks that were sent before the last message are gone, with their mesher or map.
    """

    def __init__(self) -> None:
        self.begins_anew = False
        self._epoch = _NONE_YET
        self._revisions: dict[Block, int] = {}

    def begin(self, map_epoch: int) -> bool:
        """Take no more blocks of earlier map epochs; whether there were any."""
        is_later = map_epoch > self._epoch[0]
        if is_later:
            self._epoch = (map_epoch, -1)
            self._revisions.clear()
        return is_later

    def news(self, message: MeshBlocks) -> dict[Block, Triangles | None]:
        """The blocks of a message that are newer than those before; None: no surface any more."""
        epoch = (message.map_epoch, message.series)
        is_later = epoch > self._epoch
        self.begins_anew = is_later and self._epoch != _NONE_YET
        if is_later:
            self._epoch = epoch
            self._revisions.clear()
        if epoch < self._epoch:
            return {}
        newer = {
            block: triangles
            for block, triangles in block_triangles(message).items()
            if message.revision >= self._revisions.get(block, -1)
        }
        self._revisions.update(dict.fromkeys(newer, message.revision))
        return newer


class BlockNews(NamedTuple):
    """Blocks to draw, None: no surface any more. `anew`: what was drawn of blocks before is gone."""

    anew: bool
    blocks: dict[Block, Triangles | None]


class PendingBlocks:
    """Blocks that changed and are not drawn yet, each once, for one thread that adds and one that takes.

    Memory is that of the surface, however long nothing is taken.
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
            news = self._revisions.news(message)
            if self._revisions.begins_anew:
                self._blocks, self._anew = {}, True
            self._blocks.update(news)

    def take(self, most: int | None = None) -> BlockNews:
        """The blocks that wait, the oldest first, at most `most` of them (None: all)."""
        with self._lock:
            taken = dict(islice(self._blocks.items(), most))
            for block in taken:
                del self._blocks[block]
            was_anew, self._anew = self._anew, False
            return BlockNews(was_anew, taken)

    def forget_before(self, map_epoch: int) -> None:
        """Draw no blocks of earlier map epochs: their map was thrown away."""
        with self._lock:
            if self._revisions.begin(map_epoch):
                self._blocks, self._anew = {}, False


class AssembledMesh:
    """All blocks of the live mesh as of the messages so far."""

    def __init__(self) -> None:
        self.map_version = 0
        self.map_epoch = 0
        self._revisions = BlockRevisions()
        self._blocks: dict[Block, Triangles] = {}
        self._lattice = BlockLattice(1.0, 1.0)

    def add(self, message: MeshBlocks) -> None:
        """Take in one message."""
        news = self._revisions.news(message)
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
        """One mesh; vertices on the same edge of the lattice become one. None: there is no block."""
        if not self._blocks:
            return None
        parts = [self._blocks[block] for block in sorted(self._blocks)]
        offsets = np.cumsum([0, *(len(part.vertices) for part in parts)])
        faces = np.concatenate([p.faces + o for p, o in zip(parts, offsets, strict=False)])
        vertices = np.concatenate([part.vertices for part in parts])
        colors = np.concatenate([part.colors for part in parts])
        _, first, inverse = np.unique(
            _edges(vertices, self._lattice.voxel_m), axis=0, return_index=True, return_inverse=True
        )
        a, b, c = (faces := inverse.reshape(-1)[faces]).T
        faces = faces[(a != b) & (b != c) & (c != a)].astype(np.uint32)
        return Triangles(vertices[first], faces, colors[first])


def _edges(vertices: np.ndarray, voxel_m: float) -> np.ndarray:
    """Place of each vertex on the doubled lattice, odd along its edge, [V, 3] int64."""
    cells = vertices.astype(np.float64) / voxel_m
    nearest = np.rint(cells)
    on_lattice = np.abs(cells - nearest) < _SNAP_CELLS
    return np.where(on_lattice, 2 * nearest, 2 * np.floor(cells) + 1).astype(np.int64)
