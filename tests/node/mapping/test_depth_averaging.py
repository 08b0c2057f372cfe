"""Depth of rays from a noisy sensor."""

from dataclasses import replace

import numpy as np

from hsslam_node.config.mapping import MapperConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.ray_batch import DepthAveraging, RayBatch, RayDraw, ray_batch

_CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
_UNITS_PER_M = 10_000.0
_SIGMA = 1.5e-3  # 1/m, of the inverse depth


def _slanted_floor() -> np.ndarray:
    """Depth [120, 160] m of a plane that is seen at a flat angle, 2 to 6 m."""
    v = np.mgrid[:120, :160][0]
    return 1 / (0.16 + 0.36 * v / 120)


def _store(depth_m: np.ndarray) -> KeyframeStore:
    store = KeyframeStore.create(MemoryAllocator(), _CAMERA, _UNITS_PER_M, 4)
    raw = np.rint(depth_m * _UNITS_PER_M).astype(np.uint16)
    color = np.zeros((*depth_m.shape, 3), np.uint8)
    store.append(Frame(0, 0, _CAMERA, color, raw, _UNITS_PER_M), np.eye(4))
    return store


def _error(batch: RayBatch, depth_m: np.ndarray) -> np.ndarray:
    """Of the inverse depth of each ray, 1/m."""
    u = np.rint(batch.direction[:, 0] * _CAMERA.fx + _CAMERA.cx).astype(int)
    v = np.rint(batch.direction[:, 1] * _CAMERA.fy + _CAMERA.cy).astype(int)
    return 1 / batch.depth - 1 / depth_m[v, u]


def _rays(store: KeyframeStore, window_px: int) -> RayBatch:
    batch = ray_batch(2000)
    draw = RayDraw(MapperConfig(depth_window_px=window_px))
    n = draw.fill(batch, store, np.array([0]), np.array([2000]), np.random.default_rng(0))
    assert n == 2000
    return batch


def test_the_noise_of_a_plane_goes_down_and_no_bias_comes_in():
    true = _slanted_floor()
    noisy = 1 / (1 / true + np.random.default_rng(2).normal(0, _SIGMA, true.shape))
    error = _error(_rays(_store(noisy), 5), true)
    assert np.std(_error(_rays(_store(noisy), 1), true)) > 0.9 * _SIGMA
    assert np.std(error) < 0.45 * _SIGMA
    assert abs(error.mean()) < 0.05 * _SIGMA


def test_exact_depth_is_left_as_it_is():
    store = _store(_slanted_floor())
    np.testing.assert_array_equal(_rays(store, 5).depth, _rays(store, 1).depth)


def test_two_surfaces_are_not_mixed():
    true = np.full((120, 160), 4.0)
    true[:, 80:] = 3.0
    noisy = 1 / (1 / true + np.random.default_rng(3).normal(0, _SIGMA, true.shape))
    error = _error(_rays(_store(noisy), 5), true)
    assert np.abs(error).max() < 5 * _SIGMA < 0.1 * (1 / 3 - 1 / 4)


def test_the_noise_of_each_keyframe_is_its_own():
    true = _slanted_floor()
    store, averaging = _store(true), DepthAveraging(5)
    noisy = 1 / (1 / true + np.random.default_rng(4).normal(0, _SIGMA, true.shape))
    raw = np.rint(noisy * _UNITS_PER_M).astype(np.uint16)
    store.append(replace(store.frame(0), depth_raw=raw), np.eye(4))
    assert averaging.same_surface(store, 0) == 0.0
    assert 1.6 * _SIGMA < averaging.same_surface(store, 1) < 2.4 * _SIGMA


class _RetiresWhatIsRead(KeyframeStore):
    """Another process retires a keyframe right after this one has opened its pixels."""

    def pixels(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        found = super().pixels(k)
        if k == 1 and self.is_kept(1):
            self.retire(1, 0)
        return found


def test_a_keyframe_that_is_retired_while_it_is_read_gives_no_rays():
    arrays = MemoryAllocator()
    store = KeyframeStore.create(arrays, _CAMERA, _UNITS_PER_M, 4)
    frame = _store(_slanted_floor()).frame(0)
    for _ in range(3):
        store.append(frame, np.eye(4))
    batch = ray_batch(300)
    draw = RayDraw(MapperConfig(depth_window_px=5))
    ids, counts = np.arange(3), np.full(3, 100)
    n = draw.fill(batch, _RetiresWhatIsRead(arrays), ids, counts, np.random.default_rng(0))
    assert n == 200 and set(batch.slot[:n]) == {0, 2}
