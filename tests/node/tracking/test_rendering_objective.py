"""The rendering losses of a pose: their slope, what counts, and what is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.rendering_objective import RenderingObjective
from tests.small_room import RENDERED, displaced, map_view, room_frames, room_poses, with_black

K = 14  # frame


@pytest.fixture(scope="module")
def view() -> MapView:
    return map_view(RENDERED)


def _objective(
    view, frame=None, free_sdf=RENDERED.weights.free_sdf, **options
) -> RenderingObjective:
    options = {"pixels": 500, "fresh_pixels": False, "border": 0.02, **options}
    config = replace(
        RENDERED,
        rendering_tracker=replace(RENDERED.rendering_tracker, **options),
        weights=replace(RENDERED.weights, free_sdf=free_sdf),
    )
    objective = RenderingObjective(config, 0)
    objective.observe(frame or room_frames()[K], view)
    return objective


def _slope(objective, T) -> np.ndarray:
    slope = np.zeros(6)
    for axis in range(6):
        step = np.zeros(6)
        step[axis] = 1e-4
        above = objective(moved_about_camera(T, step))[0]
        below = objective(moved_about_camera(T, -step))[0]
        slope[axis] = (above - below) / 2e-4
    return slope


ONE_TERM = dict.fromkeys(("color", "depth", "sdf_middle", "sdf_tail", "free_space"), 0.0)


@pytest.mark.parametrize(
    "weights",
    [{}, *({**ONE_TERM, name: 10.0} for name in ONE_TERM)],
    ids=["all", *ONE_TERM],
)
def test_gradient_is_the_slope_of_the_loss(view, weights):
    objective = _objective(view, free_sdf=1.0, **weights)  # else free space has no loss here
    T = displaced(room_poses()[K], 0.01, 0.5)
    _, gradient = objective(T)
    slope = _slope(objective, T)
    for part in (slice(0, 3), slice(3, 6)):
        error = np.linalg.norm(gradient[part] - slope[part])
        assert error < 0.05 * np.linalg.norm(slope[part])


def test_the_loss_grows_with_the_displacement(view):
    objective, truth = _objective(view), room_poses()[K]
    distances = (0.0, 0.01, 0.03, 0.08)
    losses = [objective(displaced(truth, d, 50 * d))[0] for d in distances]
    assert losses == sorted(losses) and losses[-1] > 3 * losses[0]


def test_outliers_have_neither_loss_nor_gradient(view):
    """A patch of wrong depth changes everything when all rays count, and little when outliers do not."""
    frame, T = room_frames()[K], displaced(room_poses()[K], 0.01, 0.5)
    wrong = frame.depth_raw.copy()
    wrong[20:50, 40:90] = np.uint16(0.5 * frame.depth_units_per_m)
    spoilt = replace(frame, depth_raw=wrong)

    def change(**options) -> float:
        clean = _objective(view, frame, **options)(T)[0]
        return _objective(view, spoilt, **options)(T)[0] / clean

    assert change(outlier_factor=0.0) > 3.0
    assert 0.7 < change(outlier_factor=3.0) < 1.4
    objective = _objective(view, spoilt, outlier_factor=3.0)
    _, gradient = objective(T)
    slope = _slope(objective, T)
    assert np.linalg.norm(gradient - slope) < 0.2 * np.linalg.norm(slope)


def test_pixels_stay_or_are_drawn_anew(view):
    T = room_poses()[K]
    fixed, fresh = _objective(view), _objective(view, fresh_pixels=True)
    assert fixed(T)[0] == fixed(T)[0] == fresh(T)[0] != fresh(T)[0]


def test_the_same_seed_gives_the_same_loss_to_the_bit(view):
    T = room_poses()[K]
    runs = [_objective(view, fresh_pixels=True) for _ in range(2)]
    for _ in range(3):
        (loss, gradient), (again, gradient_again) = (objective(T) for objective in runs)
        assert loss == again
        np.testing.assert_array_equal(gradient, gradient_again)


def test_a_frame_without_depth_has_no_loss(view):
    loss, gradient = _objective(view, with_black(room_frames()[K]))(np.eye(4))
    assert loss == float("inf") and not gradient.any()


def test_the_map_is_not_touched(view):
    before = view.params.copy()
    _objective(view)(room_poses()[K])
    np.testing.assert_array_equal(view.params, before)


def test_a_wide_border_leaves_rows_of_a_wide_image(view):
    frame = room_frames()[K]
    camera = replace(frame.camera, height_px=90)
    wide = replace(frame, color=frame.color[:90], depth_raw=frame.depth_raw[:90], camera=camera)
    assert np.isfinite(_objective(view, wide, border=0.3)(room_poses()[K])[0])
