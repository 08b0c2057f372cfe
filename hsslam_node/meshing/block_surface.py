"""The surface within one block, by marching cubes."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from skimage.measure import marching_cubes

from hsslam_node.meshing.block_mesh import BlockMesh

Block = tuple[int, int, int]
QuerySdf = Callable[[np.ndarray], np.ndarray]
"""points [N, 3] float32 m, world -> signed distance [N], any unit, positive in free space."""
QueryColor = Callable[[np.ndarray], np.ndarray]
"""points [N, 3] float32 m, world -> RGB [N, 3], 0..1."""


class BlockSpace(Protocol):
    """Space to mesh, in blocks: `ObservedSpace`, `SparseSpace` or `WholeSpace`."""

    def cells(self, block: Block) -> np.ndarray: ...

    def vertex_positions(self, block: Block, vertices: np.ndarray) -> np.ndarray: ...


def block_surface(
    space: BlockSpace,
    block: Block,
    query_sdf: QuerySdf,
    query_color: QueryColor,
    cells: np.ndarray | None = None,
) -> tuple[BlockMesh | None, int]:
    """Mesh of one block, None if it has no surface, and the number of SDF queries.

    `cells`: those of the block, if the caller has them.
    """
    cells = space.cells(block) if cells is None else cells
    corners = np.zeros(np.add(cells.shape, 1), np.bool_)
    for i, j, k in np.ndindex(2, 2, 2):
        n0, n1, n2 = cells.shape
        corners[i : i + n0, j : j + n1, k : k + n2] |= cells
    vertices = np.argwhere(corners)
    if len(vertices) == 0:
        return None, 0
    sdf = np.ones(corners.shape, np.float32)
    sdf[corners] = query_sdf(space.vertex_positions(block, vertices))
    inside = sdf[corners] < 0
    if not inside.any() or inside.all():
        return None, len(vertices)
    mask = np.zeros_like(corners)  # scikit-image masks a cell at its far corner
    mask[1:, 1:, 1:] = cells
    try:
        local, faces, _, _ = marching_cubes(sdf, 0.0, mask=mask)
    except RuntimeError:  # no surface within the mask
        return None, len(vertices)
    color = query_color(space.vertex_positions(block, local))
    rgb = np.clip(np.asarray(color) * 255.0 + 0.5, 0, 255).astype(np.uint8)
    mesh = BlockMesh(block, local.astype(np.float32), faces.astype(np.int32), rgb)
    return mesh, len(vertices)
