"""Consistency of frames under a trajectory, for sources without good ground truth."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.frame import Frame
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.source import BadFrame

GAPS_FRAMES = (10, 30, 100)
START_EVERY = 10  # frames between the first frames of pairs
SAME_SURFACE_M = 0.10  # a larger difference in depth is another surface: occlusion, not error
_LEAST_OVERLAP = 0.01  # share of the image that must see the same surface
_Pair = tuple[float, float]  # median depth difference, m, and correlation of grey values


@dataclass(frozen=True)
class Consistency:
    """How well frames `gap_frames` apart agree if the poses warp one into the other.

    `depth_median_m`: median over the pairs of the median depth difference of a pair.
    `one_minus_ncc`: mean over the pairs of 1 - normalised cross-correlation of the grey values.
    NaN without a pair.
    """

    gap_frames: int
    depth_median_m: float
    one_minus_ncc: float
    pairs: int  # that overlap and have both poses
    possible: int  # that the sequence has


def consistency(
    frames: Iterable[Frame | BadFrame],
    trajectories: Mapping[str, Trajectory],
    gaps_frames: Sequence[int] = GAPS_FRAMES,
) -> dict[str, list[Consistency]]:
    """Consistency of `frames`, every tenth of a sequence, with poses of the same stamps: for each
    trajectory, by its name, one for each gap. `frames` is read once; only those that the largest gap
    needs are kept.

    A pair starts at each frame. Every pixel with depth of the first is warped into the second; its
    depth is compared with that of the nearest pixel, its grey value with the interpolated one. Pixels
    that differ by 10 cm or more in depth are left out. A frame that cannot be read has no pair.
    """
    poses_of = {
        name: dict(zip(trajectory.stamps_ns.tolist(), trajectory.T_world_cam, strict=True))
        for name, trajectory in trajectories.items()
    }
    steps = {gap: max(round(gap / START_EVERY), 1) for gap in gaps_frames}
    found: dict[str, dict[int, list[_Pair | None]]] = {
        name: {gap: [] for gap in gaps_frames} for name in trajectories
    }
    recent: deque[Frame | BadFrame] = deque(maxlen=max(steps.values()) + 1)
    for frame in frames:
        recent.append(frame)
        for name, pose_of in poses_of.items():
            for gap, step in steps.items():
                if step < len(recent):
                    found[name][gap].append(_pair(recent[-1 - step], frame, pose_of))
    return {name: [_summary(*of_gap) for of_gap in gaps.items()] for name, gaps in found.items()}


def _summary(gap_frames: int, found: Sequence[_Pair | None]) -> Consistency:
    """Summary of the pairs of one gap."""
    possible = len(found)
    pairs = np.array([pair for pair in found if pair is not None]).reshape(-1, 2)
    if len(pairs) == 0:
        return Consistency(gap_frames, float("nan"), float("nan"), 0, possible)
    depth_m, ncc = float(np.median(pairs[:, 0])), float(pairs[:, 1].mean())
    return Consistency(gap_frames, depth_m, 1.0 - ncc, len(pairs), possible)


def _pair(
    a: Frame | BadFrame, b: Frame | BadFrame, pose_of: Mapping[int, np.ndarray]
) -> _Pair | None:
    """How two frames agree; None: no overlap, no pose, or not both can be read."""
    if isinstance(a, BadFrame) or isinstance(b, BadFrame):
        return None
    if a.stamp_ns not in pose_of or b.stamp_ns not in pose_of:
        return None
    T_b_a = inverse(pose_of[b.stamp_ns]) @ pose_of[a.stamp_ns]
    depth_m = a.depth_m()
    pixels = np.flatnonzero(depth_m)
    moved = world_points(depth_m, a.camera, T_b_a)
    c = b.camera
    z = np.where(moved[:, 2] > 0, moved[:, 2], np.nan)
    u, v = moved[:, 0] / z * c.fx + c.cx, moved[:, 1] / z * c.fy + c.cy
    inside = (u >= 0) & (v >= 0) & (u <= c.width_px - 1) & (v <= c.height_px - 1)  # NaN: outside
    u, v, z, pixels = u[inside], v[inside], z[inside], pixels[inside]
    measured = b.depth_m()[np.rint(v).astype(int), np.rint(u).astype(int)]
    difference = np.abs(z - measured)
    same = (measured > 0) & (difference < SAME_SURFACE_M)
    if same.sum() < _LEAST_OVERLAP * c.width_px * c.height_px:
        return None
    own = _grey(a).ravel()[pixels[same]]
    other = _between_pixels(_grey(b), u[same], v[same])
    return float(np.median(difference[same])), _correlation(own, other)


def _grey(frame: Frame) -> np.ndarray:
    return cv2.cvtColor(frame.color, cv2.COLOR_RGB2GRAY).astype(np.float32)


def _between_pixels(image: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Bilinear values [N] of an image at places [N]."""
    low_u = np.minimum(np.floor(u).astype(int), image.shape[1] - 2)
    low_v = np.minimum(np.floor(v).astype(int), image.shape[0] - 2)
    a, b = u - low_u, v - low_v
    top = image[low_v, low_u] * (1 - a) + image[low_v, low_u + 1] * a
    bottom = image[low_v + 1, low_u] * (1 - a) + image[low_v + 1, low_u + 1] * a
    return top * (1 - b) + bottom * b


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    """Normalised cross-correlation, -1 to 1; 0 if one of them is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / size) if size > 0 else 0.0
