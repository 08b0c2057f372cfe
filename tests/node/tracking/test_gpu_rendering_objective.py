"""The GPU's rendering losses of a pose are those of the CPU."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.rendering_tracker import RenderingTracker, surface_fit
from hsslam_node.tracking.tracked_frame import frame_points
from tests.node.gpu_kernels.interpreter import DEVICE, GPU, import_gpu_kernels
from tests.small_room import SMALL, displaced, map_view, room_frames, room_poses, with_black

import_gpu_kernels()

from hsslam_node.gpu_kernels.field.layout import gpu_layout  # noqa: E402
from hsslam_node.tracking.gpu_rendering_objective import GpuRenderingObjective  # noqa: E402
from hsslam_node.tracking.map_view import DeviceMap, MapView  # noqa: E402
from hsslam_node.tracking.rendering_objective import RenderingObjective  # noqa: E402
from tests.node.gpu_kernels.conftest import on_device  # noqa: E402

K = 14  # frame


@pytest.fixture(scope="module")
def view() -> MapView:
    view = map_view()
    on_gpu = DeviceMap(GPU, gpu_layout(view.layout, DEVICE), on_device(view.params))
    return replace(view, on_device=on_gpu)


def _twins(view, **options) -> tuple[RenderingObjective, GpuRenderingObjective]:
    config = replace(
        SMALL, rendering_tracker=replace(SMALL.rendering_tracker, pixels=32, **options)
    )
    return RenderingObjective(config, 0), GpuRenderingObjective(config, 0, view)


@pytest.mark.parametrize("columns", [None, 30], ids=["all depth", "fewer pixels than wanted"])
def test_loss_and_gradient_are_those_of_the_twin(view, columns):
    """Twice, as each call draws fresh pixels; outliers are left out."""
    T = displaced(room_poses()[K], 0.02, 1.0)
    depth = room_frames()[K].depth_raw.copy()
    depth[:, : depth.shape[1] // 2] *= columns is None
    depth[:, depth.shape[1] // 2 :][:, columns:] = 0
    frame = replace(room_frames()[K], depth_raw=depth)
    found = []
    for objective in _twins(view, outlier_factor=2.0):
        objective.observe(frame, view)
        found.append([objective(T) for _ in range(2)])
    for (expected, expected_gradient), (loss, gradient) in zip(*found, strict=True):
        assert loss == pytest.approx(expected, rel=1e-3)
        error = np.linalg.norm(gradient - expected_gradient)
        assert error < 2e-3 * np.linalg.norm(expected_gradient)
    assert found[1][0][0] != found[1][1][0]


def test_a_pose_is_judged_by_the_map_that_was_rendered(view):
    """Others may overwrite the parameters in host memory meanwhile."""
    points, T = frame_points(room_frames()[K], SMALL.tracker, 0)[::8].copy(), room_poses()[K]
    torn = replace(view, params=np.full_like(view.params, np.nan))
    expected = surface_fit(points, T, replace(view, on_device=None), SMALL.tracker)
    found = surface_fit(points, T, torn, SMALL.tracker)
    assert expected.inlier_ratio > 0.9 and found.outside == expected.outside
    assert found.inlier_ratio == pytest.approx(expected.inlier_ratio, abs=0.01)
    assert found.rms_m == pytest.approx(expected.rms_m, rel=0.01)


def test_the_tracker_asks_the_map_where_it_is(view):
    short = {"iterations": 2, "settling_iterations": 1, "first_descents": 1}
    options = replace(SMALL.rendering_tracker, pixels=24, fresh_pixels=False, **short)
    few = replace(SMALL.tracker, points=300, surface_points=0)
    config = replace(SMALL, tracker=few, rendering_tracker=options)
    first, second = room_frames()[:2]
    poses = []
    for where in (view, replace(view, on_device=None)):
        store = KeyframeStore.create(
            MemoryAllocator(), first.camera, first.depth_units_per_m, capacity=8
        )
        tracker = RenderingTracker(config, store, 0)
        tracker.track(first, where)
        result = tracker.track(second, where)
        assert result.status == "tracked"
        poses.append(result.T_world_cam)
    assert not np.array_equal(*poses)  # by another machine
    np.testing.assert_allclose(*poses, atol=1e-4)
    assert np.abs(poses[0] - np.eye(4)).max() > 1e-3


def test_a_frame_without_depth_has_no_loss(view):
    _, gpu = _twins(view)
    gpu.observe(with_black(room_frames()[K]), view)
    loss, gradient = gpu(np.eye(4))
    assert loss == float("inf") and not gradient.any()
