"""Gauss-Newton alignment of one frame: to the SDF map, to a keyframe's surface and to its image.

In directions that these leave open, the pose stays near the predicted motion.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.pose_covariance import Evidence
from hsslam_node.geometry.se3 import inverse, moved_about_camera, so3_log, transformed
from hsslam_node.kernels.tracking.alignment import add_keyframe_surface_term, add_photometric_term
from hsslam_node.kernels.tracking.depth_points import transform_points
from hsslam_node.tracking.keyframes.reference_keyframe import PyramidLevel, ReferenceKeyframe
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.sdf_term import CpuSdfTerm, SdfEvidence, SdfTerm

LEVER_M = 2.0  # a rotation counts as the way of what is so far away


def with_motion_prior(
    H: np.ndarray,
    b: np.ndarray,
    T_world_cam: np.ndarray,
    prediction: np.ndarray,
    weak_m: float,
    doubt: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Normal equations H [8, 8], b [8] whose weak directions are held at the predicted pose [4, 4].

    Along each eigenvector of the pose's information (gain and bias eliminated) the prior weighs
    w^2 / information with w = 1 / weak_m^2: next to nothing where the data tell the way to much better
    than weak_m, nearly all where they tell it much worse, as along the axis of a bare corridor.

    doubt: covariance [6, 6] of the prediction, as of `moved_about_camera`: no direction is held by more
    than the prediction knows of it. None: it is a motion that goes on as it was.
    """
    scale = np.array([1.0, 1.0, 1.0, 1 / LEVER_M, 1 / LEVER_M, 1 / LEVER_M])
    pose = pose_information(H)
    information, direction = np.linalg.eigh(scale[:, None] * pose * scale)
    least = 1.0 / weak_m**2
    strength = least**2 / np.maximum(information, 1e-3 * least)  # [6]
    if doubt is not None:
        of_way = doubt / scale[:, None] / scale
        strength = np.minimum(strength, 1 / np.einsum("ji,jk,ki->i", direction, of_way, direction))
    unscaled = direction / scale[:, None]
    P = (unscaled * strength) @ unscaled.T
    H, b = H.copy(), b.copy()
    H[:6, :6] += P
    b[:6] += P @ _way(prediction, T_world_cam)
    return H, b


def pose_information(H: np.ndarray) -> np.ndarray:
    """[6, 6] of the pose alone from [8, 8], gain and bias eliminated; the Schur complement."""
    return H[:6, :6] - H[:6, 6:] @ np.linalg.solve(H[6:, 6:], H[6:, :6])


def _way(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Twist [6] (m, rad; world axes, rotation about the camera) from one pose to the other."""
    return np.concatenate(
        [end[:3, 3] - start[:3, 3], so3_log(end[:3, :3] @ inverse(start)[:3, :3])]
    )


COARSE_STRIDE = 4  # every fourth depth point at all levels but the last
_MOST_ASKED = 1.25  # times `config.points`, as frames have some more
_COARSE_STOP = 1e-3  # m, rad
_DAMPING = 1e-4
_LOWER = np.tril_indices(8, -1)
# of a step (m, rad, grey levels, gain): where nothing else says anything, stay
_PRIOR = np.array([1e-9] * 6 + [1 / 20.0**2, 1 / 0.2**2])


class Exposure(NamedTuple):
    """The image is gain times the keyframe's plus bias."""

    bias: float = 0.0  # grey levels
    gain: float = 1.0


_SAME_EXPOSURE = Exposure()


@dataclass(frozen=True)
class Alignment:
    """A pose with the evidence for it."""

    T_world_cam: np.ndarray  # [4, 4]
    iterations: int
    sdf_inlier_ratio: float  # inliers over points in the bound; nan without a map
    sdf_rms_m: float  # of the inliers; nan without a map
    surface_inlier_ratio: float  # nan without the term
    surface_coverage: float  # share of the points that met the keyframe's surface
    photometric_inlier_ratio: float  # nan without the term
    outside: int  # points outside the bound
    exposure: Exposure = _SAME_EXPOSURE
    information: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))
    """[6, 6] of a twist (m, rad) as in `moved_about_camera`, with gain and bias left free."""
    evidence: Evidence | None = None


def align(
    points: np.ndarray,
    levels: tuple[PyramidLevel, ...],
    T_world_cam: np.ndarray,
    view: MapView | None,
    reference: ReferenceKeyframe | None,
    T_world_ref: np.ndarray,
    config: TrackerConfig,
    exposure: Exposure = _SAME_EXPOSURE,
    doubt: np.ndarray | None = None,
) -> Alignment:
    """Align a frame, coarse to fine, starting from `T_world_cam` [4, 4].

    Args:
        points: [N, 3] float32 m, depth points in the camera frame; all of them are aligned to the
            keyframe's surface at the finest level, about `config.points` of them to the map.
        levels: image pyramid of the frame.
        view: the map; None before there is one.
        reference: the keyframe; None leaves its two terms out.
        T_world_ref: [4, 4] pose of the keyframe.
        exposure: where to start.
        doubt: covariance [6, 6] of `T_world_cam` if odometry foretells it, as in `with_motion_prior`.
    """
    problem = _Problem(points, levels, view, reference, T_world_ref, config, exposure)
    T = T_world_cam.copy()
    iterations = 0
    system = None
    for level in range(len(levels)):
        fine = level == len(levels) - 1
        for _ in range(config.iterations):
            system = problem.linearise(T, level)
            H, b = system.H, system.b
            if fine:
                H, b = with_motion_prior(H, b, T, T_world_cam, config.weak_direction_m, doubt)
            x = np.linalg.solve(H + _DAMPING * np.diag(np.diag(H)), -b)
            T = moved_about_camera(T, x[:6])
            problem.exposure = Exposure(problem.exposure.bias + x[6], problem.exposure.gain + x[7])
            iterations += 1
            if np.abs(x[:6]).max() < (config.stop_step if fine else _COARSE_STOP):
                break
    assert system is not None
    nan = float("nan")
    return Alignment(
        T_world_cam=T,
        iterations=iterations,
        sdf_inlier_ratio=system.sdf_inliers / max(system.sdf_seen, 1) if view else nan,
        sdf_rms_m=float(np.sqrt(system.sdf_squares / max(system.sdf_inliers, 1))) if view else nan,
        surface_inlier_ratio=_ratio(system.surface_inliers, system.surface_met),
        surface_coverage=system.surface_met / max(len(points), 1),
        photometric_inlier_ratio=_ratio(system.photo_inliers, system.photo_seen),
        outside=system.outside,
        information=pose_information(system.H),
        evidence=system.evidence(),
        exposure=problem.exposure,
    )


@dataclass
class _System:
    H: np.ndarray
    b: np.ndarray
    sdf_inliers: int = 0
    sdf_seen: int = 0
    sdf_squares: float = 0.0
    outside: int = 0
    surface_inliers: int = 0
    surface_met: int = 0
    surface_cost: float = 0.0
    photo_inliers: int = 0
    photo_seen: int = 0
    photo_cost: float = 0.0
    H_before_surface: np.ndarray | None = None  # upper half, as the following
    H_before_photo: np.ndarray | None = None

    def evidence(self) -> Evidence:
        """Once H is complete."""
        before_photo = self.H if self.H_before_photo is None else self.H_before_photo
        before_surface = before_photo if self.H_before_surface is None else self.H_before_surface
        return Evidence(
            H=self.H,
            H_surface=_mirrored(before_photo - before_surface),
            H_photometric=_mirrored(self.H - before_photo),
            surface_cost=self.surface_cost / max(self.surface_met, 1),
            photometric_cost=self.photo_cost / max(self.photo_seen, 1),
        )


class _Problem:
    """The terms of one frame and the work space to linearise them."""

    def __init__(
        self,
        points: np.ndarray,
        levels: tuple[PyramidLevel, ...],
        view: MapView | None,
        reference: ReferenceKeyframe | None,
        T_world_ref: np.ndarray,
        config: TrackerConfig,
        exposure: Exposure,
    ) -> None:
        self._asked_every = 1 + int(len(points) / (_MOST_ASKED * config.points))
        asked = np.ascontiguousarray(points[:: self._asked_every])
        coarse = np.ascontiguousarray(asked[::COARSE_STRIDE])
        self._points = (coarse, points)
        self._levels = levels
        self._sdf_term = open_sdf_term(view, (coarse, asked), config) if view else None
        self._reference = reference
        self._config = config
        self._T_ref_world = inverse(T_world_ref)
        self._key_world = (
            tuple(transformed(T_world_ref, p) for p in reference.points) if reference else ()
        )
        self._world = np.empty((len(points), 3), np.float32)
        self.exposure = exposure

    def linearise(self, T: np.ndarray, level: int) -> _System:
        """The normal equations at T, at one level of the pyramid."""
        c = self._config
        system = _System(np.diag(_PRIOR), np.zeros(8))
        fine = level == len(self._levels) - 1
        points = self._points[fine]
        n = len(points)
        world = self._world[:n]
        transform_points(T, points, world)
        centre = T[:3, 3].copy()
        # the map is asked last, and first only where there is no keyframe to lead the way
        if self._sdf_term and (fine or self._reference is None):
            asked = np.ascontiguousarray(world[:: self._asked_every]) if fine else world
            found = self._add_sdf_term(T, asked, fine, system)
            system.sdf_inliers, system.sdf_seen, system.sdf_squares = found
            system.outside = len(asked) - found.seen
        if self._reference and c.surface_weight > 0:
            k = c.surface_weight**-0.5
            sigma_m, noise = c.sdf_sigma_m, c.sdf_sigma_slope  # wide enough to be led by
            if fine:
                sigma_m, noise = c.surface_sigma_m, self._reference.depth_noise
            system.H_before_surface = system.H.copy()
            found = add_keyframe_surface_term(
                points, world, centre, self._T_ref_world, self._reference.surface_points,
                self._reference.surface_normals, self._reference.surface_K,
                k * sigma_m, k * noise, c.surface_noise, c.surface_kernel, c.sdf_huber_m, c.surface_gate_m,
                system.H, system.b,
            )  # fmt: skip
            system.surface_cost, system.surface_inliers, system.surface_met = found
        if self._reference and c.photometric_pixels:
            image = self._levels[level]
            system.H_before_photo = system.H.copy()
            found = add_photometric_term(
                image.grey, image.depth, image.K, self._key_world[level],
                self._reference.grey[level], T, *self.exposure, c.photometric_sigma,
                c.photometric_huber, system.H, system.b,
            )  # fmt: skip
            system.photo_cost, system.photo_inliers, system.photo_seen = found
        system.H[_LOWER] = system.H.T[_LOWER]
        return system

    def _add_sdf_term(
        self, T: np.ndarray, world: np.ndarray, fine: bool, system: _System
    ) -> SdfEvidence:
        """Add what the map says, by its weight; in full if there is no keyframe."""
        assert self._sdf_term is not None
        weight = self._config.sdf_weight if self._reference else 1.0
        if weight == 1.0:
            return self._sdf_term.add(T, world, fine, system.H, system.b)
        H, b = np.zeros_like(system.H), np.zeros_like(system.b)
        found = self._sdf_term.add(T, world, fine, H, b)
        system.H += weight * H
        system.b += weight * b
        return found


def _mirrored(upper: np.ndarray) -> np.ndarray:
    """A symmetric matrix of its upper half."""
    out = upper.copy()
    out[_LOWER] = upper.T[_LOWER]
    return out


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")


def open_sdf_term(
    view: MapView, points: tuple[np.ndarray, np.ndarray], config: TrackerConfig
) -> SdfTerm:
    """The term for points (of coarse levels, of the fine one), each [N, 3] float32 m, camera frame."""
    if view.on_device is not None:
        from hsslam_node.tracking.on_gpu import GpuSdfTerm

        return GpuSdfTerm(view, points, config)
    return CpuSdfTerm(view, points, config)
