"""The mesh of a growing map, block by block: only blocks whose surface has changed are meshed again."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from hsslam_node.meshing.block_mesh import BlockMesh, without_specks
from hsslam_node.meshing.block_surface import Block, QueryColor, QuerySdf, block_surface
from hsslam_node.meshing.sparse_space import SparseSpace

_PROBES = 48  # vertices of a block whose SDF shows whether its surface has moved
_PROBED_AT_ONCE = 256  # blocks
_MOVED_CELLS = 0.2  # less is no change
_MOVED_SHARE = 0.1  # of the probes
_NEW_CELLS = 12  # new cells with surface after which a block is meshed again
_COLOR_STEP = 16  # of 255; less is no change
_SPECK_FACES = 50
_AGAIN_SHARE = 0.05  # of all blocks, which a refresh meshes again whatever their probes show

HasTime = Callable[[], bool]


@dataclass(frozen=True)
class Refresh:
    """Result of a refresh: changed blocks (None: no surface), and the numbers of meshed and waiting ones."""

    changed: dict[Block, BlockMesh | None]
    asked: int
    waiting: int


@dataclass(frozen=True)
class _Kept:
    mesh: BlockMesh
    probes: np.ndarray  # [P, 3] float32 m, world
    probed: np.ndarray  # [P] float32, signed distances there when the block was meshed


class LiveMesh:
    """Keeps a mesh of each block; memory grows with the surface.

    Example:
        mesh = LiveMesh(SparseSpace(voxel_m=0.03), truncation_m=0.06)
        mesh.look_at(mesh.space.take_grown())
        changed = mesh.refresh(query_sdf, query_color, lambda: True).changed
    """

    def __init__(self, space: SparseSpace, truncation_m: float) -> None:
        self.space = space
        self._half_cell = 0.5 * space.voxel_m / truncation_m
        self._tolerance = _MOVED_CELLS * space.voxel_m / truncation_m
        self._kept: dict[Block, _Kept] = {}
        self._waiting: dict[Block, None] = {}  # in order of arrival
        self._cells: dict[Block, np.ndarray] = {}  # those meshed last, as bits
        self._grown: dict[Block, None] = {}  # may have more cells
        self._moved: list[Block] = []  # the most moved last
        self._next = 0

    @property
    def waiting(self) -> int:
        """Number of blocks that are to be checked or meshed."""
        return len(self._waiting) + len(self._grown)

    @property
    def meshes(self) -> list[BlockMesh]:
        """The meshes of all blocks that have a surface."""
        return [kept.mesh for kept in self._kept.values()]

    def want(self, blocks: Iterable[Block]) -> None:
        """Mesh these blocks at the next refresh."""
        self._waiting.update(dict.fromkeys(blocks))

    def look_at(self, blocks: Iterable[Block]) -> None:
        """Mesh these blocks at the next refresh if their new cells hold surface."""
        self._grown.update(dict.fromkeys(blocks))

    def want_hidden(self) -> None:
        """Mesh the blocks with marks that had no surface: the map may cover them now."""
        self.want(block for block in self.space.blocks() if block not in self._kept)

    def take_space(self, space: SparseSpace) -> None:
        """Replace the marks by those of corrected poses."""
        self.want(self.space.differing_blocks(space))
        self.space = space

    def probe(self, query_sdf: QuerySdf, has_time: HasTime) -> None:
        """Find the blocks whose surface has moved, and those with surface in new cells."""
        self._look_at_grown(query_sdf, has_time)
        blocks = list(self._kept)
        moved: list[tuple[float, Block]] = []
        for first in range(0, len(blocks), _PROBED_AT_ONCE):
            some = [self._kept[block] for block in blocks[first : first + _PROBED_AT_ONCE]]
            now = query_sdf(np.concatenate([kept.probes for kept in some]))
            shift = np.abs(now - np.concatenate([kept.probed for kept in some]))
            begins = np.cumsum([0, *(len(kept.probes) for kept in some)])[:-1]
            shares = np.add.reduceat(shift > self._tolerance, begins) / np.diff(
                [*begins, len(shift)]
            )
            moved += [
                (share, kept.mesh.block)
                for share, kept in zip(shares.tolist(), some, strict=True)
                if share > _MOVED_SHARE
            ]
        self._moved = [block for _, block in sorted(moved)]

    def refresh(self, query_sdf: QuerySdf, query_color: QueryColor, has_time: HasTime) -> Refresh:
        """Mesh waiting blocks, oldest first, those that moved most, then others, while there is time."""
        changed: dict[Block, BlockMesh | None] = {}
        asked = 0
        others = list(dict.fromkeys([*self._moved[::-1], *self._others()]))[::-1]  # from the end
        while (self._waiting or others) and (asked == 0 or has_time()):
            block = next(iter(self._waiting)) if self._waiting else others.pop()
            self._waiting.pop(block, None)
            cells = self.space.cells(block)
            self._cells[block] = np.packbits(cells)
            found, _ = block_surface(self.space, block, query_sdf, query_color, cells)
            asked += 1
            self._take(block, found, changed, query_sdf)
        self._moved = []
        return Refresh(changed, asked, self.waiting)

    def _others(self) -> list[Block]:
        """Some blocks in turn, for changes that probes miss."""
        blocks = sorted(self._kept)
        n = len(blocks)
        first, count = self._next, int(np.ceil(_AGAIN_SHARE * n))
        self._next += count
        return [blocks[(first + k) % n] for k in range(count)]

    def _take(
        self,
        block: Block,
        found: BlockMesh | None,
        changed: dict[Block, BlockMesh | None],
        query_sdf: QuerySdf,
    ) -> None:
        if found is not None:
            found = without_specks(found, self.space.block_cells, _SPECK_FACES)
        known = self._kept.get(block)
        if found is None:
            if known is not None:
                del self._kept[block]
                changed[block] = None
        elif known is None or _differ(known.mesh, found):
            step = max(len(found.vertices) // _PROBES, 1)
            probes = self.space.vertex_positions(block, found.vertices[::step])
            self._kept[block] = _Kept(found, probes, query_sdf(probes))
            changed[block] = found

    def _look_at_grown(self, query_sdf: QuerySdf, has_time: HasTime) -> None:
        looked = 0
        while self._grown and (looked == 0 or has_time()):
            block, _ = self._grown.popitem()
            looked += 1
            if block in self._waiting:
                continue
            cells = self.space.cells(block)
            if block in self._cells:
                n = self.space.block_cells
                meshed = np.unpackbits(self._cells[block], count=n**3).reshape(n, n, n)
                cells = cells & ~meshed.view(np.bool_)
            centres = self.space.vertex_positions(block, np.argwhere(cells) + 0.5)
            if len(centres) < _NEW_CELLS:
                continue
            has_surface = np.abs(query_sdf(centres)) < self._half_cell
            if np.count_nonzero(has_surface) >= _NEW_CELLS:
                self._waiting[block] = None


def _differ(a: BlockMesh, b: BlockMesh) -> bool:
    if a.vertices.shape != b.vertices.shape or not np.array_equal(a.faces, b.faces):
        return True
    if np.abs(a.vertices - b.vertices).max() > _MOVED_CELLS:
        return True
    return bool(np.abs(a.colors.astype(np.int16) - b.colors).max() > _COLOR_STEP)
