"""Pose graph: keyframe poses from measured relative poses (edges), by sparse Gauss-Newton."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, csc_array
from scipy.sparse.linalg import splu

from hsslam_node.geometry.se3_batch import (
    adjoint_batch,
    exp_batch,
    inverse_batch,
    log_batch,
    log_jacobian_batch,
)


@dataclass(frozen=True)
class PoseEdge:
    """Measured pose of keyframe `second` relative to keyframe `first`."""

    first: int
    second: int
    T_first_second: np.ndarray  # [4, 4]
    information: np.ndarray  # [6, 6] inverse covariance of (m, rad) in the camera frame of `second`
    switchable: bool  # whether it may be an outlier, as a loop closure may


@dataclass(frozen=True)
class PoseEdges:
    """m edges as arrays."""

    first: np.ndarray  # [m] int64
    second: np.ndarray  # [m] int64
    T_first_second: np.ndarray  # [m, 4, 4]
    information: np.ndarray  # [m, 6, 6]
    switchable: np.ndarray  # [m] bool

    @classmethod
    def of(cls, edges: Sequence[PoseEdge]) -> "PoseEdges":
        """Stack single edges."""
        return cls(
            np.array([e.first for e in edges], np.int64),
            np.array([e.second for e in edges], np.int64),
            np.array([e.T_first_second for e in edges]).reshape(-1, 4, 4),
            np.array([e.information for e in edges]).reshape(-1, 6, 6),
            np.array([e.switchable for e in edges], bool),
        )


_STOP = 1e-5  # m, rad
_DAMPING = 1e-9  # share of the diagonal
_FADING = 2.5  # factor by which the kernel narrows each iteration


@dataclass(frozen=True)
class PoseGraphResult:
    """A solved graph."""

    T_world_cam: np.ndarray  # [n, 4, 4]
    weights: np.ndarray  # [m] 0..1, of each edge; 1 if it is not switchable
    cost_before: float  # sum of the edges' costs
    cost_after: float


def solve_pose_graph(
    T_world_cam: np.ndarray,
    edges: PoseEdges,
    fixed: np.ndarray,
    *,
    kernel: float = 4.0,
    iterations: int = 50,
) -> PoseGraphResult:
    """Poses [n, 4, 4] that fit the edges best. Poses with `fixed` [n] bool stay; edges that are not
    switchable must connect all others to them.

    Residual r of an edge: log(T_first_second^-1 T_world_first^-1 T_world_second) (m, rad); its cost is r^T
    information r. Switchable edges have a Geman-McClure kernel of `kernel` standard deviations, reached by
    graduated non-convexity (Yang et al. 2020): at first all edges count in full, then edges that contradict
    the others lose their weight. So even a wrong edge of high information does little harm.
    """
    poses = T_world_cam.copy()
    limit = kernel**2
    switchable = edges.switchable
    residuals = _residuals(poses, edges)
    squares = _squares(residuals, edges)
    before = _cost(squares, edges, limit)
    weights = np.ones(len(edges.first))
    widened = max(1.0, 2.0 * float(squares[switchable].max(initial=0.0)) / limit)
    unknown = np.flatnonzero(~fixed)
    for _ in range(iterations if len(unknown) else 0):
        scale = widened * limit
        weights[switchable] = (scale / (squares[switchable] + scale)) ** 2
        step = _step(poses, residuals, edges, weights, fixed)
        poses[unknown] = poses[unknown] @ exp_batch(step)
        residuals = _residuals(poses, edges)
        squares = _squares(residuals, edges)
        if widened == 1.0 and np.abs(step).max() < _STOP:
            break
        widened = max(1.0, widened / _FADING)
    weights[switchable] = (limit / (squares[switchable] + limit)) ** 2
    return PoseGraphResult(poses, weights, before, _cost(squares, edges, limit))


def _residuals(poses: np.ndarray, edges: PoseEdges) -> np.ndarray:
    """[m, 6]."""
    relative = inverse_batch(poses[edges.first]) @ poses[edges.second]
    return log_batch(inverse_batch(edges.T_first_second) @ relative)


def _squares(residuals: np.ndarray, edges: PoseEdges) -> np.ndarray:
    """Squared Mahalanobis length of each edge's residual, [m]."""
    return np.einsum("mi,mi->m", residuals, (edges.information @ residuals[..., None])[..., 0])


def _cost(squares: np.ndarray, edges: PoseEdges, limit: float) -> float:
    bounded = limit * squares / (squares + limit)
    return float(np.where(edges.switchable, bounded, squares).sum())


def _step(
    poses: np.ndarray,
    residuals: np.ndarray,
    edges: PoseEdges,
    weights: np.ndarray,
    fixed: np.ndarray,
) -> np.ndarray:
    """Gauss-Newton step [u, 6] of the u unknown poses, each moved as T exp(step)."""
    J_second = log_jacobian_batch(residuals)  # [m, 6, 6]
    relative = inverse_batch(poses[edges.second]) @ poses[edges.first]
    J = (-J_second @ adjoint_batch(relative), J_second)
    W = weights[:, None, None] * edges.information
    WJ = W @ J[0], W @ J[1]
    slot = np.where(fixed, -1, np.cumsum(~fixed) - 1)  # [n] row of the unknown
    ends = slot[edges.first], slot[edges.second]
    u = int((~fixed).sum())
    blocks, rows, columns = [], [], []
    g = np.zeros((u, 6))
    for a in range(2):
        free = ends[a] >= 0
        gradient = np.swapaxes(WJ[a][free], 1, 2) @ residuals[free][..., None]
        np.add.at(g, ends[a][free], gradient[..., 0])
        for b in range(2):
            both = free & (ends[b] >= 0)
            blocks.append(np.swapaxes(J[a][both], 1, 2) @ WJ[b][both])
            rows.append(ends[a][both])
            columns.append(ends[b][both])
    H = _assembled(np.concatenate(blocks), np.concatenate(rows), np.concatenate(columns), u)
    solver = splu(H, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    return -solver.solve(g.ravel()).reshape(u, 6)


def _assembled(blocks: np.ndarray, rows: np.ndarray, columns: np.ndarray, u: int) -> csc_array:
    """Damped matrix [6 u, 6 u] of blocks [b, 6, 6] at block rows and columns; blocks at one place add up."""
    place, slot = np.unique(rows * u + columns, return_inverse=True)
    summed = np.zeros((len(place), 6, 6))
    np.add.at(summed, slot, blocks)
    block_rows, block_columns = place // u, place % u
    k = np.arange(6)
    diagonal = np.flatnonzero(block_rows == block_columns)
    summed[diagonal[:, None], k, k] *= 1.0 + _DAMPING
    starts = np.concatenate([[0], np.cumsum(np.bincount(block_rows, minlength=u))])
    return bsr_array((summed, block_columns, starts), shape=(6 * u, 6 * u)).tocsc()
