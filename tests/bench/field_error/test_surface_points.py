from dataclasses import replace

import numpy as np

from hsslam_bench.field_error.surface_points import surface_points, times_seen
from hsslam_bench.field_error.true_frames import TrueFrame, true_frames
from tests.small_room import OPTIONS, room_frames, room_poses


def _view(k: int) -> TrueFrame:
    frame = room_frames()[k]
    return TrueFrame(frame, room_poses()[k], frame.depth_m())


def test_points_lie_on_the_surface_and_normals_point_away_from_the_camera() -> None:
    view = _view(0)
    points = surface_points(view, np.random.default_rng(0))
    assert len(points.world) > 200
    u, v = points.pixel.T
    np.testing.assert_allclose(points.depth_m, view.depth_m[v, u])
    away = np.einsum("ni,ni->n", points.normal, points.world - view.T_world_cam[:3, 3])
    assert (away > 0).all()
    assert (points.cosine <= 1 + 1e-6).all()


def test_views_that_look_there_are_counted() -> None:
    points = surface_points(_view(2), np.random.default_rng(0))
    views = [(room_poses()[k], _view(k).depth_m) for k in (0, 1)]
    blind = (room_poses()[0], np.zeros_like(_view(0).depth_m))
    camera = room_frames()[0].camera
    seen = times_seen(points.world, [*views, blind], camera, 10.0)
    assert np.median(seen) == 2
    assert times_seen(points.world, views, camera, 0.2).max() == 0


def test_noise_changes_what_is_sensed_and_not_what_is_true() -> None:
    exact = next(iter(true_frames("synth:room", OPTIONS)))
    noisy = next(iter(true_frames("synth:room", replace(OPTIONS, noise="kinect"))))
    np.testing.assert_array_equal(exact.depth_m, noisy.depth_m)
    assert (exact.frame.depth_raw != noisy.frame.depth_raw).mean() > 0.5
    np.testing.assert_allclose(exact.T_world_cam, np.eye(4), atol=1e-9)
