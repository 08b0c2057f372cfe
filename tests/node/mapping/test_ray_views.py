"""Depth of rays from a noisy sensor, averaged over the keyframes near theirs."""

import numpy as np
import pytest

from hsslam_node.config.mapping import MOST_RAY_VIEWS, MapperConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import pixel_rays
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.ray_batch import RayBatch, RayDraw, ray_batch

_CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
_UNITS_PER_M = 10_000.0
_SIGMA = 1.5e-3  # 1/m, of the inverse depth
_UNTRACKED = np.eye(6)
_COLOR = np.zeros((120, 160, 3), np.uint8)


def _pose(k: int) -> np.ndarray:
    """T_world_cam of keyframe k: some centimetres and degrees from the others."""
    return se3_exp(np.random.default_rng(k).uniform(-0.05, 0.05, 6))


def _inverse_depth(T_world_cam: np.ndarray, wall_m: float) -> np.ndarray:
    """Of the wall z = `wall_m` of the world as a camera sees it, [120, 160] 1/m."""
    v, u = np.mgrid[:120, :160]
    rays = pixel_rays(u.ravel(), v.ravel(), _CAMERA)
    inverse = rays @ T_world_cam[2, :3] / (wall_m - T_world_cam[2, 3])
    return inverse.reshape(120, 160)


def _append(
    store: KeyframeStore, k: int, wall_m: float, sigma: float = _SIGMA, gap: bool = False
) -> None:
    noise = np.random.default_rng(1000 + k).normal(0, sigma, (120, 160)) if sigma else 0.0
    depth_m = 1 / (_inverse_depth(_pose(k), wall_m) + noise)
    raw = np.rint(depth_m * _UNITS_PER_M).astype(np.uint16)
    frame = Frame(k, k, _CAMERA, _COLOR, raw, _UNITS_PER_M)
    store.append(frame, _pose(k), gap_covariance=_UNTRACKED if gap else np.zeros((6, 6)))


def _store(walls_m: list[float], sigma: float = _SIGMA, gap_before: int = 0) -> KeyframeStore:
    store = KeyframeStore.create(MemoryAllocator(), _CAMERA, _UNITS_PER_M, 32)
    for k, wall_m in enumerate(walls_m):
        _append(store, k, wall_m, sigma, gap=k > 0 and k == gap_before)
    return store


def _rays(store: KeyframeStore, views: int, keyframe: int = 4) -> RayBatch:
    batch = ray_batch(2000)
    draw = RayDraw(MapperConfig(depth_window_px=5, ray_views=views))
    ids, counts = np.array([keyframe]), np.array([2000])
    assert draw.fill(batch, store, ids, counts, np.random.default_rng(0)) == 2000
    return batch


def _error(batch: RayBatch, wall_m: float = 3.0, keyframe: int = 4) -> np.ndarray:
    """Of the inverse depth of each ray, 1/m."""
    T = _pose(keyframe)
    return 1 / batch.depth - batch.direction @ T[2, :3] / (wall_m - T[2, 3])


@pytest.mark.parametrize(("views", "share"), [(2, 0.85), (MOST_RAY_VIEWS, 0.65)])
def test_the_noise_goes_down_with_the_views_and_no_bias_comes_in(views, share):
    store = _store([3.0] * 9)
    alone, error = _error(_rays(store, 0)), _error(_rays(store, views))
    assert np.std(error) < share * np.std(alone)
    assert abs(error.mean()) < 0.05 * _SIGMA


def test_a_keyframe_of_another_surface_does_not_count():
    """The wall has moved by 30 cm; beside it is one keyframe that saw it where it is now."""
    store = _store([3.3, 3.3, 3.3, 3.0, 3.0, 3.3, 3.3, 3.3, 3.3])
    both = _store([3.3, 3.3, 3.3, 3.0, 3.0])
    np.testing.assert_array_equal(_rays(store, 8).depth, _rays(both, 8).depth)
    assert abs(_error(_rays(store, 8)).mean()) < 0.05 * _SIGMA


def test_keyframes_beyond_a_motion_that_was_not_tracked_do_not_count():
    parted, alone = _store([3.0] * 9, gap_before=4), _store([3.0] * 9)
    for k in range(4):
        alone.retire(k, 4)
    np.testing.assert_array_equal(_rays(parted, 8).depth, _rays(alone, 8).depth)


def test_views_follow_corrections_of_their_poses():
    store = _store([3.0] * 9)
    off = se3_exp(np.array([0.0, 0.0, 0.01, 0.0, 0.0, 0.0]))
    others = np.delete(np.arange(9), 4)
    store.correct_poses(others, off @ store.poses_of(others))
    bias = _error(_rays(store, 8)).mean()
    assert bias < -0.1 * (1 / 3.0 - 1 / 3.01)  # the others place the wall 1 cm farther


def test_exact_depth_is_left_as_it_is():
    store = _store([3.0] * 9, sigma=0.0)
    np.testing.assert_array_equal(_rays(store, 8).depth, _rays(store, 0).depth)


class _RetiresWhatIsDrawn(KeyframeStore):
    """Another process retires a keyframe after this one has looked up which are near."""

    def pixels(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        if k == 4 and self.is_kept(5):
            self.retire(5, 4)
        return super().pixels(k)


def test_a_view_that_is_retired_meanwhile_costs_no_ray():
    arrays = MemoryAllocator()
    store = KeyframeStore.create(arrays, _CAMERA, _UNITS_PER_M, 32)
    for k in range(9):
        _append(store, k, 3.0)
    alone = _rays(store, 0).depth
    np.testing.assert_array_equal(_rays(_RetiresWhatIsDrawn(arrays), 8).depth, alone)
