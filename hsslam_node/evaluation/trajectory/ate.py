"""Absolute trajectory error."""

import warnings
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from hsslam_node.evaluation.trajectory.mean_transform import mean_transform
from hsslam_node.geometry.se3 import transformed
from hsslam_node.geometry.trajectory import Trajectory, associate

_NARROW_M = 0.1


@dataclass(frozen=True)
class AteResult:
    """Distances between true and estimated camera centres after alignment; NaN with under 3 poses.

    A frame without an estimate is not in the error but in `expected - scored`: report both.
    """

    rmse_m: float
    mean_m: float
    max_m: float
    scored: int
    expected: int
    T_truth_estimate: np.ndarray  # [4, 4], maps the estimate's world to the truth's; see `ate`
    stamps_ns: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))  # [scored]
    errors_m: np.ndarray = field(default_factory=lambda: np.zeros(0))  # [scored], in order of time


def ate(estimate: Trajectory, truth: Trajectory, max_dt_s: float = 0.02) -> AteResult:
    """Error over all frames after one rigid alignment without scale (Horn 1987; TUM protocol).

    Poses are paired by stamp, the closest first, at most `max_dt_s` apart. `T_truth_estimate` is this
    alignment. If the path is narrower than 10 cm (RMS across its longest axis), as of a camera that moves
    straight, turns or stands still, its positions do not fix the rotation; then it is the mean of the
    poses' transforms.
    """
    source, target = associated(estimate, truth, max_dt_s)
    expected = len(truth)
    if len(source) < 3:
        nan = float("nan")
        return AteResult(nan, nan, nan, len(source), expected, np.eye(4))
    T = align(source.positions, target.positions)
    moved = transformed(T, source.positions)
    errors = np.linalg.norm(moved - target.positions, axis=1)
    is_wide = _width_m(target.positions) >= _NARROW_M
    return AteResult(
        rmse_m=float(np.sqrt(np.mean(errors**2))),
        mean_m=float(errors.mean()),
        max_m=float(errors.max()),
        scored=len(source),
        expected=expected,
        T_truth_estimate=T if is_wide else mean_transform(source.T_world_cam, target.T_world_cam),
        stamps_ns=target.stamps_ns,
        errors_m=errors,
    )


def associated(
    estimate: Trajectory, truth: Trajectory, max_dt_s: float = 0.02
) -> tuple[Trajectory, Trajectory]:
    """The poses of both, paired, in order of time; at most `max_dt_s` apart."""
    pairs = _pairs(estimate, truth, max_dt_s)
    rows_e, rows_t = np.array(pairs, np.int64).reshape(-1, 2).T
    return (
        Trajectory(estimate.stamps_ns[rows_e], estimate.T_world_cam[rows_e]),
        Trajectory(truth.stamps_ns[rows_t], truth.T_world_cam[rows_t]),
    )


def at_true_stamps(estimate: Trajectory, truth: Trajectory, max_dt_s: float = 0.02) -> Trajectory:
    """The same poses, with the stamps of the true poses that they belong to, as `ate` pairs them.

    True poses have the stamps of frames, to the ns; files of other systems have six decimals, or stamps of
    their own. A pose without a true one keeps its stamp.
    """
    stamps_ns = estimate.stamps_ns.copy()
    rows_e, rows_t = np.array(_pairs(estimate, truth, max_dt_s), np.int64).reshape(-1, 2).T
    stamps_ns[rows_e] = truth.stamps_ns[rows_t]
    return Trajectory(stamps_ns, estimate.T_world_cam)


def align(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Rigid transform [4, 4] that maps points `source` [N, 3] to `target` [N, 3], least squares."""
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    with warnings.catch_warnings():
        # on a straight line the rotation about it is free, which leaves the errors as they are
        warnings.filterwarnings("ignore", "Optimal rotation is not uniquely", UserWarning)
        rotation = Rotation.align_vectors(target - target_mean, source - source_mean)[0]
    T = np.eye(4)
    T[:3, :3] = rotation.as_matrix()
    T[:3, 3] = target_mean - T[:3, :3] @ source_mean
    return T


def _width_m(positions: np.ndarray) -> float:
    """RMS extent of points [n, 3] along the second longest of their axes."""
    centred = positions - positions.mean(axis=0)
    return float(np.linalg.svd(centred, compute_uv=False)[1] / np.sqrt(len(centred)))


def _pairs(estimate: Trajectory, truth: Trajectory, max_dt_s: float) -> list[tuple[int, int]]:
    order_e, order_t = np.argsort(estimate.stamps_ns), np.argsort(truth.stamps_ns)
    pairs = associate(estimate.stamps_ns[order_e], truth.stamps_ns[order_t], round(max_dt_s * 1e9))
    return [(int(order_e[i]), int(order_t[j])) for i, j in pairs]
