"""Normal equations of one frame's pose and exposure, 6 + 2 unknowns, from map, surface and image."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.geometry.pose_covariance import Evidence
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.kernels.tracking.alignment import add_keyframe_surface_term, add_photometric_term
from hsslam_node.kernels.tracking.depth_points import transform_points
from hsslam_node.tracking.alignment.sdf_term import CpuSdfTerm, SdfEvidence, SdfTerm
from hsslam_node.tracking.keyframes.reference_keyframe import PyramidLevel, ReferenceKeyframe
from hsslam_node.tracking.map_view import MapView

_COARSE_STRIDE = 4  # every fourth depth point at all levels but the last
_MOST_QUERIED = 1.25  # times `config.points`, as frames have some more
_LOWER = np.tril_indices(8, -1)
# information of a step (m, rad, grey levels, gain): no step where no term constrains it
_PRIOR = np.array([1e-9] * 6 + [1 / 20.0**2, 1 / 0.2**2])


class Exposure(NamedTuple):
    """Image = gain * image of the keyframe + bias."""

    bias: float = 0.0  # grey levels
    gain: float = 1.0


@dataclass
class NormalEquations:
    """H x = -b of a step in pose, bias and gain, and how well each term fits."""

    H: np.ndarray  # [8, 8]
    b: np.ndarray  # [8]
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
    is_averaged: bool = False  # depth, over pixels
    H_before_surface: np.ndarray | None = None  # upper half, as the following
    H_before_photo: np.ndarray | None = None

    def evidence(self) -> Evidence:
        """The evidence, once H is complete."""
        before_photo = self.H if self.H_before_photo is None else self.H_before_photo
        before_surface = before_photo if self.H_before_surface is None else self.H_before_surface
        return Evidence(
            H=self.H,
            H_surface=_mirrored(before_photo - before_surface),
            H_photometric=_mirrored(self.H - before_photo),
            surface_cost=self.surface_cost / max(self.surface_met, 1),
            photometric_cost=self.photo_cost / max(self.photo_seen, 1),
            is_averaged=self.is_averaged,
        )


class FrameTerms:
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
        self._query_stride = 1 + int(len(points) / (_MOST_QUERIED * config.points))
        queried = np.ascontiguousarray(points[:: self._query_stride])
        coarse = np.ascontiguousarray(queried[::_COARSE_STRIDE])
        self._points = (coarse, points)
        self._levels = levels
        self._sdf_term = open_sdf_term(view, (coarse, queried), config) if view else None
        self._reference = reference
        self._config = config
        self._T_ref_world = inverse(T_world_ref)
        self._key_world = (
            tuple(transformed(T_world_ref, p) for p in reference.points) if reference else ()
        )
        self._world = np.empty((len(points), 3), np.float32)
        self.exposure = exposure

    def linearise(self, T: np.ndarray, level: int) -> NormalEquations:
        """The normal equations at T, at one level of the pyramid."""
        c = self._config
        system = NormalEquations(np.diag(_PRIOR), np.zeros(8))
        fine = level == len(self._levels) - 1
        points = self._points[fine]
        n = len(points)
        world = self._world[:n]
        transform_points(T, points, world)
        centre = T[:3, 3].copy()
        # the map is queried at the finest level; without a keyframe, at all levels
        if self._sdf_term and (fine or self._reference is None):
            queried = np.ascontiguousarray(world[:: self._query_stride]) if fine else world
            found = self._add_sdf_term(T, queried, fine, system)
            system.sdf_inliers, system.sdf_seen, system.sdf_squares = found
            system.outside = len(queried) - found.seen
        if self._reference and c.surface_weight > 0:
            k = c.surface_weight**-0.5
            sigma_m, noise = c.sdf_sigma_m, c.sdf_sigma_slope  # wide, for the coarse levels
            if fine:
                sigma_m, noise = c.surface_sigma_m, self._reference.depth_noise
            system.is_averaged = self._reference.averaging_limit > 0
            share = c.surface_noise_averaged if system.is_averaged else c.surface_noise
            system.H_before_surface = system.H.copy()
            found = add_keyframe_surface_term(
                points, world, centre, self._T_ref_world, self._reference.surface_points,
                self._reference.surface_normals, self._reference.surface_K,
                k * sigma_m, k * noise, share, c.surface_kernel, c.sdf_huber_m, c.surface_gate_m,
                system.H, system.b,
            )  # fmt: skip
            system.surface_cost, system.surface_inliers, system.surface_met = found
        if self._reference and c.photometric_pixels:
            image = self._levels[level]
            system.H_before_photo = system.H.copy()
            found = add_photometric_term(
                image.grey, image.depth, image.depth_step, image.K, self._key_world[level],
                self._reference.grey[level], T, *self.exposure, c.photometric_sigma,
                c.photometric_huber, system.H, system.b,
            )  # fmt: skip
            system.photo_cost, system.photo_inliers, system.photo_seen = found
        system.H[_LOWER] = system.H.T[_LOWER]
        return system

    def _add_sdf_term(
        self, T: np.ndarray, world: np.ndarray, fine: bool, system: NormalEquations
    ) -> SdfEvidence:
        """Add the map's term by its weight; with weight 1 if there is no keyframe."""
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
    """A symmetric matrix from its upper half."""
    out = upper.copy()
    out[_LOWER] = upper.T[_LOWER]
    return out


def open_sdf_term(
    view: MapView, points: tuple[np.ndarray, np.ndarray], config: TrackerConfig
) -> SdfTerm:
    """The SDF term for points (coarse levels, finest level), each [N, 3] float32 m, camera frame."""
    if view.on_device is not None:
        from hsslam_node.tracking.alignment.gpu_sdf_term import GpuSdfTerm

        return GpuSdfTerm(view, points, config)
    return CpuSdfTerm(view, points, config)
