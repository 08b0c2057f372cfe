"""Depth of a keyframe averaged over the keyframes next to it."""

from dataclasses import replace

import cv2
import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.keyframes.other_views import views_near
from hsslam_node.tracking.keyframes.reference_keyframe import grey_pyramid, reference_keyframe

_CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
_UNITS_PER_M = 10_000.0
_CONFIG = TrackerConfig(photometric_pixels=300)


def _averaging(views: int) -> TrackerConfig:
    return replace(_CONFIG, depth_window_px=5, reference_views=views)


_SIGMA = 1.5e-3  # 1/m, of the inverse depth
_NORMAL, _DISTANCE_M = np.array([0.16, -0.12, np.sqrt(0.96)]), 2.0  # of a plane, world
_V, _U = np.mgrid[:120, :160]
_RAYS = np.stack([(_U - _CAMERA.cx) / _CAMERA.fx, (_V - _CAMERA.cy) / _CAMERA.fy], -1)


def _pose(k: int) -> np.ndarray:
    return se3_exp(np.array([0.02, -0.01, 0.015, 0.004, 0.006, -0.01]) * k)


def _plane_m(T_world_cam: np.ndarray) -> np.ndarray:
    """Depth [120, 160] m of the plane."""
    directions = np.concatenate([_RAYS, np.ones((120, 160, 1))], -1) @ T_world_cam[:3, :3].T
    return (_DISTANCE_M - _NORMAL @ T_world_cam[:3, 3]) / (directions @ _NORMAL)


def _frame(
    k: int, nearer_m: float = 0.0, sigma: float = _SIGMA, noise: np.ndarray | None = None
) -> Frame:
    if noise is None:
        noise = np.random.default_rng(k).normal(0, sigma, (120, 160)) if sigma else np.zeros(1)
    depth_m = 1 / (1 / (_plane_m(_pose(k)) - nearer_m) + noise)
    raw = np.rint(depth_m * _UNITS_PER_M).astype(np.uint16)
    color = np.random.default_rng(100).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    return Frame(4 * k, 0, _CAMERA, color, raw, _UNITS_PER_M)


def _store(frames: list[Frame]) -> KeyframeStore:
    store = KeyframeStore.create(MemoryAllocator(), _CAMERA, _UNITS_PER_M, 16)
    for k, frame in enumerate(frames):
        store.append(frame, _pose(k))
    return store


def _errors(store: KeyframeStore, k: int, most: int) -> np.ndarray:
    """Of the inverse depth that the pixels of keyframe k have with its views, 1/m."""
    frame = store.frame(k)
    views = views_near(store, k, frame, _averaging(most))
    assert bool(views) == bool(most)
    depth_m = frame.depth_m().ravel()
    if views:
        depth_m = views.averaged(_RAYS.reshape(-1, 2), depth_m, 1)
    return 1 / depth_m - 1 / _plane_m(_pose(k)).ravel()


def test_views_of_the_same_plane_take_noise_away_and_bring_no_bias():
    store = _store([_frame(k) for k in range(9)])
    alone, few, many = (_errors(store, 8, most) for most in (0, 2, 8))
    assert np.std(alone) > 0.9 * _SIGMA
    assert np.std(few) < 0.6 * _SIGMA
    assert np.std(many) < 0.4 * _SIGMA
    assert abs(many.mean()) < 0.05 * _SIGMA


def test_what_stands_before_the_plane_in_another_view_is_not_mixed_in():
    store = _store([_frame(0), *(_frame(k, nearer_m=0.2) for k in (1, 2)), _frame(3)])
    np.testing.assert_allclose(_errors(store, 3, 2), _errors(store, 3, 0), atol=1e-6)
    assert np.std(_errors(store, 3, 3)) < 0.75 * _SIGMA  # of the two beside that, one is behind


def test_the_nearest_kept_keyframes_are_taken():
    store = _store([_frame(k) for k in range(6)])
    store.retire(2, 0)
    views = views_near(store, 3, store.frame(3), _averaging(3))
    assert views
    taken = [store.pixels(k)[1] for k in (4, 1, 5)]
    assert len(views.depth_raw) == 3
    for raw, expected in zip(views.depth_raw, taken, strict=True):
        np.testing.assert_array_equal(raw, expected)


def test_unknown_depth_stays_unknown():
    store = _store([_frame(k) for k in range(3)])
    frame = store.frame(2)
    depth_m = frame.depth_m()
    depth_m[:, :80] = 0
    views = views_near(store, 2, frame, _averaging(2))
    assert views
    averaged = views.averaged(_RAYS.reshape(-1, 2), depth_m.ravel(), 1)
    np.testing.assert_array_equal(averaged == 0, depth_m.ravel() == 0)


def test_a_reference_of_noisy_depth_is_nearer_to_the_plane_with_views():
    store = _store([_frame(k) for k in range(9)])
    frame = store.frame(8)
    off_m = []
    for views in (None, views_near(store, 8, frame, _averaging(8))):
        reference = reference_keyframe(8, frame, grey_pyramid(frame), _CONFIG, views)
        known = reference.surface_normals.any(axis=2)
        for points in (reference.surface_points[known], reference.points[-1]):
            world = points @ _pose(8)[:3, :3].T + _pose(8)[:3, 3]
            off_m.append(np.sqrt(np.mean((world @ _NORMAL - _DISTANCE_M) ** 2)))
    assert off_m[2] < 0.6 * off_m[0]
    assert off_m[3] < 0.4 * off_m[1]


def test_exact_depth_has_no_views():
    store = _store([_frame(k, sigma=0.0) for k in range(4)])
    assert views_near(store, 3, store.frame(3), _averaging(3)) is None


def test_large_images_have_fewer_views():
    frames = [_frame(k) for k in range(4)]
    store = _store(frames)
    wide = replace(_CAMERA, width_px=1280, height_px=960)
    color, depth = np.tile(frames[3].color, (8, 8, 1)), np.tile(frames[3].depth_raw, (8, 8))
    large = Frame(12, 0, wide, color, depth, _UNITS_PER_M)
    views = views_near(store, 3, large, _averaging(3))
    assert views and len(views.depth_raw) == 2


def test_views_end_where_the_motion_was_not_tracked():
    store = _store([_frame(k) for k in range(3)])
    store.append(_frame(3), _pose(3), gap_covariance=np.eye(6))
    for k in range(4, 6):
        store.append(_frame(k), _pose(k))
    seen = []
    for k in (2, 3):
        views = views_near(store, k, store.frame(k), _averaging(8))
        assert views
        seen.append(len(views.depth_raw))
    assert seen == [2, 2]


def test_a_reference_of_noisy_depth_is_averaged_over_pixels_if_the_configuration_says_so():
    noisy, exact = _frame(0), _frame(0, sigma=0.0)
    for frame, config, is_averaged in (
        (noisy, _averaging(0), True), (noisy, _CONFIG, False), (exact, _averaging(0), False),
    ):  # fmt: skip
        reference = reference_keyframe(0, frame, grey_pyramid(frame), config)
        assert (reference.averaging_limit > 0) == is_averaged


def test_no_views_are_averaged_if_neighbouring_pixels_err_alike():
    shared = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, (120, 160)), (0, 0), 3.0)
    frame = _frame(3, noise=_SIGMA * shared / shared.std())
    store = _store([_frame(k) for k in range(3)] + [frame])
    assert views_near(store, 3, frame, _averaging(3)) is None
