"""A prepared keyframe: image pyramid, salient pixels, surface with normals."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.tracking.keyframes.reference_keyframe import grey_pyramid, reference_keyframe
from tests.small_room import room_frames

NORMAL = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])  # towards the camera
DISTANCE_M = 2.0
_CONFIG = TrackerConfig(photometric_pixels=300)


def _plane(width: int = 160, height: int = 120) -> Frame:
    """A slanted plane with a checkered texture, and a hole."""
    camera = Camera(width, height, 130.0, 132.0, width / 2 - 0.5, height / 2 - 0.5)
    v, u = np.mgrid[:height, :width]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    depth = -DISTANCE_M / (rays @ NORMAL)
    depth[40:60, 40:60] = 0
    grey = (60 + 120 * ((u // 10 + v // 10) % 2)).astype(np.uint8)
    color = np.repeat(grey[..., None], 3, axis=2)
    return Frame(0, 0, camera, color, np.rint(depth * 10000).astype(np.uint16), 10000.0)


@pytest.mark.parametrize("size", [(160, 120), (150, 101), (77, 66)])
def test_pyramid_images_fit_their_depth(size):
    frame = _plane(*size)
    levels = grey_pyramid(frame)
    assert [level.grey.shape for level in levels] == [level.depth.shape for level in levels]
    assert levels[-1].grey.shape == (size[1], size[0])
    for level in levels:  # the plane is where the level's own intrinsics see it
        v, u = np.nonzero(level.depth)
        fx, fy, cx, cy = level.K
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1)
        distance = -(rays @ NORMAL) * level.depth[v, u]
        np.testing.assert_allclose(distance, DISTANCE_M, atol=2e-4)
    reference = reference_keyframe(0, frame, levels, _CONFIG)
    assert len(reference.points[-1]) > 50


def test_salient_pixels_are_back_projected_texture_with_depth():
    frame = _plane()
    levels = grey_pyramid(frame)
    reference = reference_keyframe(7, frame, levels, _CONFIG)
    assert reference.id == 7
    for level, points, grey in zip(levels, reference.points, reference.grey, strict=True):
        fx, fy, cx, cy = level.K
        u = points[:, 0] / points[:, 2] * fx + cx
        v = points[:, 1] / points[:, 2] * fy + cy
        np.testing.assert_allclose([u, v], np.rint([u, v]), atol=1e-9)
        u, v = np.rint(u).astype(int), np.rint(v).astype(int)
        np.testing.assert_array_equal(points[:, 2], level.depth[v, u])
        np.testing.assert_array_equal(grey, level.grey[v, u])
        assert (level.depth[v, u] > 0).all()
    assert 200 < len(reference.points[-1]) <= 400
    points = reference.points[-1]  # the texture's edges lie at multiples of ten pixels
    u = np.rint(points[:, 0] / points[:, 2] * levels[-1].K[0] + levels[-1].K[2])
    v = np.rint(points[:, 1] / points[:, 2] * levels[-1].K[1] + levels[-1].K[3])
    off = np.minimum(np.abs((u + 5) % 10 - 5), np.abs((v + 5) % 10 - 5))
    assert (off <= 1).mean() > 0.95


def test_a_blank_wall_has_no_salient_pixels():
    frame = _plane()
    frame.color[:] = 90
    reference = reference_keyframe(0, frame, grey_pyramid(frame), _CONFIG)
    assert [len(p) for p in reference.points] == [0, 0, 0, 0]


@pytest.mark.parametrize("is_noisy", [False, True])
def test_surface_of_a_plane(is_noisy):
    """Exact depth is taken as it is, noisy depth at half resolution and smoothed."""
    frame = _plane()
    if is_noisy:
        sigma = 20.0 * np.random.default_rng(0).normal(size=frame.depth_raw.shape)  # 2 mm
        noisy = (frame.depth_raw + np.rint(sigma)).astype(np.uint16)
        frame = replace(frame, depth_raw=np.where(frame.depth_raw > 0, noisy, 0).astype(np.uint16))
    reference = reference_keyframe(0, frame, grey_pyramid(frame), _CONFIG)
    normals, points = reference.surface_normals, reference.surface_points
    assert normals.shape == points.shape == ((60, 80, 3) if is_noisy else (120, 160, 3))
    known = np.linalg.norm(normals, axis=-1) > 0
    assert known.mean() > 0.8
    hole = slice(20, 30) if is_noisy else slice(40, 60)
    assert not known[hole, hole].any()
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=-1), 1, atol=1e-5)
    angles = np.rad2deg(np.arccos(np.clip(np.abs(normals[known] @ NORMAL), 0, 1)))
    assert np.quantile(angles, 0.95) < (4.0 if is_noisy else 1.0)
    distance = np.abs(points[known] @ NORMAL + DISTANCE_M)
    assert np.quantile(distance, 0.95) < (2e-3 if is_noisy else 2e-4)
    assert len({*np.sign(normals[known] @ NORMAL)}) == 1  # all on one side


def test_the_floor_is_a_surface_for_a_camera_of_few_pixels():
    """Its depth changes from pixel to pixel by more than 5 %, though there is no edge."""
    camera = Camera(120, 90, 60.0, 60.0, 59.5, 44.5)
    v, u = np.mgrid[:90, :120]
    down, pitch = (v - camera.cy) / camera.fy, np.deg2rad(35)
    nearness = down * np.cos(pitch) + np.sin(pitch)  # of the floor, 1 m below the camera
    depth_m = np.where(nearness > 0.2, 1 / np.maximum(nearness, 0.2), 0.0)
    noise = 1 + 2e-3 * depth_m * np.random.default_rng(0).normal(size=depth_m.shape)
    grey = (60 + 120 * ((u // 4 + v // 4) % 2)).astype(np.uint8)
    depth = np.rint(depth_m * noise * 10000).astype(np.uint16)
    frame = Frame(0, 0, camera, np.repeat(grey[..., None], 3, axis=2), depth, 10000.0)
    levels = grey_pyramid(frame)
    reference = reference_keyframe(0, frame, levels, _CONFIG)
    floor = (levels[2].depth > 0) & (levels[2].depth < 1.6)
    floor[-2:], floor[:, :2], floor[:, -2:] = False, False, False  # no normals at the border
    known = np.linalg.norm(reference.surface_normals, axis=-1) > 0
    assert known[floor].mean() > 0.9
    assert len(reference.points[2]) > 50


def test_salient_pixels_of_the_room():
    frame = room_frames()[0]
    levels = grey_pyramid(frame)
    reference = reference_keyframe(0, frame, levels, TrackerConfig(photometric_pixels=500))
    assert all(len(p) > 20 for p in reference.points[1:])
    assert all((p[:, 2] > 0.1).all() for p in reference.points)


def test_salient_pixels_do_not_depend_on_where_in_memory_the_images_lie():
    """Of few grey levels, so that gradients (5, 0) and (3, 4) compete: rounding must not choose."""
    frame = _plane(480, 360)
    rng = np.random.default_rng(0)
    grey = 10 * rng.integers(0, 5, (360, 480)).astype(np.float32)
    level = replace(grey_pyramid(frame)[-1], grey=grey)
    config = TrackerConfig(photometric_pixels=4000)
    chosen, kept = set(), []
    np.empty(30_000_000, np.uint8)  # freed: from now on large arrays come from the heap
    for _ in range(50):
        kept.append(np.empty(int(rng.integers(1, 100_000)), np.uint8))  # shifts what comes next
        chosen.add(reference_keyframe(0, frame, (level,), config).points[0].tobytes())
    assert len(chosen) == 1
