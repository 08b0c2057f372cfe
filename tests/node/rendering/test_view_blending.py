"""Colours of a wall from images of it, against the wall's own."""

from collections.abc import Sequence

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.rendering.view_blending import PosedImages, blend_views

_CAMERA = Camera(64, 48, 60.0, 60.0, 31.5, 23.5)
_WALL_M = 2.0


def _pose(x: float, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def _seen(T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Colour and depth of a wall with waves on it at z = 2 m, from a camera that looks along z."""
    depth_m = _WALL_M - T[2, 3]
    v, u = np.mgrid[: _CAMERA.height_px, : _CAMERA.width_px]
    x = T[0, 3] + (u - _CAMERA.cx) / _CAMERA.fx * depth_m
    y = T[1, 3] + (v - _CAMERA.cy) / _CAMERA.fy * depth_m
    waves = np.stack([np.sin(4 * x), np.sin(5 * y), np.cos(3 * x + 3 * y)], -1)
    return (128 + 100 * waves).astype(np.uint8), np.full(u.shape, depth_m, np.float32)


def _images(poses: Sequence[np.ndarray]) -> PosedImages:
    return PosedImages(_CAMERA, np.stack(poses), lambda k: _seen(poses[k]))


@pytest.mark.parametrize("pose", [_pose(0.05, 0.03), _pose(-0.1), _pose(0.0, 0.0, 0.4)])
def test_a_view_between_images_has_the_colours_of_the_surface(pose):
    poses = [_pose(x, y) for x in (-0.3, 0.0, 0.3) for y in (-0.2, 0.2)]
    true, depth_m = _seen(pose)
    color, shown = blend_views(depth_m, _CAMERA, pose, _images(poses))
    assert shown.all()
    assert np.abs(color - true).mean() < 2 and np.abs(color - true).max() < 12


def test_the_view_of_an_image_is_that_image():
    poses = [_pose(0.5 * k) for k in range(3)]
    true, depth_m = _seen(poses[1])
    color, shown = blend_views(depth_m, _CAMERA, poses[1], _images(poses))
    inside = np.s_[1:-1, 1:-1]  # an image fades out at its border
    assert shown[inside].all()
    assert np.abs(color - true)[inside].mean() < 0.5


def test_an_image_does_not_show_what_was_behind_something_when_it_was_taken():
    def with_a_box(k: int) -> tuple[np.ndarray, np.ndarray]:
        color, depth_m = _seen(np.eye(4))
        color[:, :20], depth_m[:, :20] = 255, 1.0
        return color, depth_m

    true, depth_m = _seen(np.eye(4))
    images = PosedImages(_CAMERA, np.eye(4)[None], with_a_box)
    color, shown = blend_views(depth_m, _CAMERA, np.eye(4), images)
    assert not shown[:, :20].any() and not color[:, :20].any()
    assert shown[1:-1, 20:-1].all() and np.abs(color - true)[1:-1, 20:-1].mean() < 0.5


def test_an_image_of_the_other_side_of_a_thin_wall_does_not_show_this_side():
    behind = _pose(0.0, 0.0, 2 * _WALL_M)
    behind[0, 0] = behind[2, 2] = -1.0
    images = PosedImages(_CAMERA, behind[None], lambda _: _seen(np.eye(4)))
    assert not blend_views(_seen(np.eye(4))[1], _CAMERA, np.eye(4), images)[1].any()


def test_a_farther_image_shows_what_the_nearest_ones_do_not():
    """Ten images are close to the view and lack the right half of the wall."""
    poses = [_pose(0.001 * k) for k in range(10)]

    def image(k: int) -> tuple[np.ndarray, np.ndarray]:
        color, depth_m = _seen((*poses, _pose(0.6))[k])
        if k < len(poses):
            depth_m[:, 32:] = 0
        return color, depth_m

    images = PosedImages(_CAMERA, np.stack([*poses, _pose(0.6)]), image)
    true, depth_m = _seen(np.eye(4))
    color, shown = blend_views(depth_m, _CAMERA, np.eye(4), images)
    assert shown[2:-2, 2:-2].all()
    assert np.abs(color - true)[2:-2, 2:-2].mean() < 2


def test_no_surface_and_no_image_show_nothing():
    depth_m = _seen(np.eye(4))[1]
    nothing = PosedImages(_CAMERA, np.zeros((0, 4, 4)), lambda k: _seen(np.eye(4)))
    assert not blend_views(depth_m, _CAMERA, np.eye(4), nothing)[1].any()
    depth_m[:24] = 0
    shown = blend_views(depth_m, _CAMERA, np.eye(4), _images([np.eye(4)]))[1]
    assert not shown[:24].any() and shown[24:-1, 1:-1].all()
