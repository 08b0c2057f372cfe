"""A wall with a pattern, seen by a few keyframes: which of them gives the colours, and where they lie."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from hsslam_node.dense_map.keyframes import MapKeyframes
from hsslam_node.errors import UserError
from hsslam_node.evaluation.image_quality import psnr_db
from hsslam_node.evaluation.mesh.mesh_view import MeshView
from hsslam_node.geometry.camera import Camera
from hsslam_node.texture.textured_mesh import textured_mesh

_CAMERA = Camera(160, 120, 130.0, 130.0, 79.5, 59.5)
_WALL_M, _FAR_M = 2.0, 3.0  # before the first camera and before one that steps back
_CELL_M = 0.02


def _wall() -> trimesh.Trimesh:
    """A grey wall of 1.6 x 1.2 m, of cells of 2 cm; its front looks at the cameras."""
    x, y = np.meshgrid(np.arange(-0.8, 0.81, _CELL_M), np.arange(-0.6, 0.61, _CELL_M))
    rows, columns = x.shape
    vertices = np.stack([x, y, np.full(x.shape, _WALL_M)], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    one = np.stack([corner, corner + columns, corner + 1], axis=1)
    other = np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1)
    grey = np.full((len(vertices), 3), 128, np.uint8)
    return trimesh.Trimesh(vertices, np.vstack([one, other]), vertex_colors=grey, process=False)


def _image(distance_m: float) -> np.ndarray:
    """The pattern on the wall, a colour for each place, as a camera before its middle sees it."""
    v, u = np.mgrid[: _CAMERA.height_px, : _CAMERA.width_px]
    x = (u - _CAMERA.cx) / _CAMERA.fx * distance_m
    y = (v - _CAMERA.cy) / _CAMERA.fy * distance_m
    waves = np.stack([np.sin(40 * x), np.sin(30 * y), np.sin(25 * (x + y))], axis=-1)
    return (128 + 70 * waves).astype(np.uint8)


def _keyframes(*distances_m: float) -> MapKeyframes:
    """They stand before the wall, with exact depth."""
    poses = np.tile(np.eye(4), (len(distances_m), 1, 1))
    poses[:, 2, 3] = _WALL_M - np.array(distances_m)
    size = _CAMERA.height_px, _CAMERA.width_px
    numbers = np.arange(len(poses))

    def depth_m(k: int) -> np.ndarray:
        return np.full(size, distances_m[k], np.float32)

    return MapKeyframes(_CAMERA, numbers, numbers, poses, depth_m)


def _sees_half() -> MapKeyframes:
    """One stands 80 cm beside the middle of the wall."""
    before = _keyframes(_WALL_M)
    return replace(
        before, T_world_cam=before.T_world_cam + 0.8 * np.eye(4)[0][:, None] * np.eye(4)[3]
    )


def _drawn_psnr(mesh: trimesh.Trimesh, true: np.ndarray) -> float:
    """Of the inner part of the first camera's view, which all keyframes see."""
    image, depth_m = MeshView(mesh).draw(_CAMERA, np.eye(4))
    inner = np.s_[25:-25, 35:-35]
    np.testing.assert_allclose(depth_m[inner], _WALL_M, rtol=1e-5)
    return psnr_db(image[inner], true[inner] / 255.0)


def test_the_texture_shows_what_the_keyframe_saw():
    wall, true = _wall(), _image(_WALL_M)
    textured = textured_mesh(wall, _keyframes(_WALL_M), lambda _: true, 1024)
    assert len(textured.faces) == len(wall.faces)
    np.testing.assert_allclose(textured.area, wall.area, rtol=1e-3)
    assert _drawn_psnr(textured, true) > 32
    assert _drawn_psnr(wall, true) < 20  # the control: the colours of vertices are grey


def test_the_sharper_of_two_images_gives_the_colours():
    true = _image(_WALL_M)
    blurred = cv2.GaussianBlur(true, (0, 0), 3)
    for images in ([true, blurred], [blurred, true]):
        textured = textured_mesh(_wall(), _keyframes(_WALL_M, _WALL_M), images.__getitem__, 1024)
        assert _drawn_psnr(textured, true) > 30


def test_the_nearer_of_two_keyframes_gives_the_colours_where_it_sees():
    near, far = _image(_WALL_M), np.zeros_like(_image(_FAR_M))
    far[...] = (250, 250, 250)
    textured = textured_mesh(_wall(), _keyframes(_FAR_M, _WALL_M), [far, near].__getitem__, 1024)
    assert _drawn_psnr(textured, near) > 30


def test_keyframes_of_other_exposure_are_made_alike():
    true = _image(_WALL_M)
    dark = (true * 0.7).astype(np.uint8)
    left = true.copy(), dark.copy()
    keyframes = _keyframes(_WALL_M, _WALL_M)
    textured = textured_mesh(_wall(), keyframes, left.__getitem__, 1024)
    between = true * np.sqrt(0.7)
    assert _drawn_psnr(textured, between) > 30


def test_what_stood_before_the_wall_gives_it_no_colour():
    true = _image(_WALL_M)
    with_person = true.copy()
    with_person[30:90, 40:80] = (255, 0, 255)
    plain = _keyframes(_WALL_M, _WALL_M)

    def depth_m(k: int) -> np.ndarray:
        depth = np.full(true.shape[:2], _WALL_M, np.float32)
        if k == 0:
            depth[30:90, 40:80] = 1.0
        return depth

    keyframes = MapKeyframes(_CAMERA, plain.ids, plain.stamps_ns, plain.T_world_cam, depth_m)
    textured = textured_mesh(_wall(), keyframes, [with_person, true].__getitem__, 1024)
    assert _drawn_psnr(textured, true) > 28


def test_pixels_that_a_mask_leaves_out_give_no_colour():
    """As those that show the robot itself, which have no depth in any keyframe."""
    true, depth = _image(_WALL_M), np.full((_CAMERA.height_px, _CAMERA.width_px), _WALL_M)
    with_robot, depth = true.copy(), depth.astype(np.float32)
    with_robot[40:80, 60:100], depth[40:80, 60:100] = (255, 0, 255), 0.0
    plain = _keyframes(*[_WALL_M] * 5)
    keyframes = replace(plain, depth_m=lambda _: depth)
    textured = textured_mesh(_wall(), keyframes, lambda _: with_robot, 1024)
    image, _ = MeshView(textured).draw(_CAMERA, np.eye(4))
    np.testing.assert_allclose(255 * image[45:75, 65:95], 128, atol=1)
    beside = np.s_[45:75, 105:120]
    assert psnr_db(image[beside], true[beside] / 255.0) > 30


def test_a_keyframe_with_depth_gives_the_colours_of_what_a_mask_leaves_out_of_another():
    true, depth = _image(_WALL_M), np.full((_CAMERA.height_px, _CAMERA.width_px), _WALL_M)
    with_person, masked = true.copy(), depth.astype(np.float32)
    with_person[40:80, 60:100], masked[40:80, 60:100] = (255, 0, 255), 0.0
    measured = [masked, depth.astype(np.float32)]
    keyframes = replace(_keyframes(_WALL_M, _WALL_M), depth_m=measured.__getitem__)
    textured = textured_mesh(_wall(), keyframes, [with_person, true].__getitem__, 1024)
    assert _drawn_psnr(textured, true) > 28


def test_what_no_keyframe_sees_has_the_colours_of_vertices():
    turned = np.diag([-1.0, 1.0, -1.0, 1.0])
    away = replace(_keyframes(_WALL_M), T_world_cam=turned[None])
    textured = textured_mesh(_wall(), away, lambda _: _image(_WALL_M), 1024)
    image, depth_m = MeshView(textured).draw(_CAMERA, np.eye(4))
    np.testing.assert_allclose(255 * image[depth_m > 0], 128, atol=1)


def test_the_texture_is_no_larger_than_asked_for():
    textured = textured_mesh(_wall(), _keyframes(_WALL_M), lambda _: _image(_WALL_M), 256)
    material = textured.visual.material  # type: ignore[union-attr]
    assert max(material.baseColorTexture.size) <= 256


def test_many_triangles_that_no_keyframe_sees_take_no_pixels_from_those_that_one_sees():
    wall, true = _wall(), _image(_WALL_M)
    slope = np.stack([128 + 100 * wall.vertices[:, k] for k in (0, 1, 0)], axis=1).astype(np.uint8)
    wall.visual.vertex_colors = slope  # type: ignore[union-attr]
    sees_half = _sees_half()
    textured = textured_mesh(wall, sees_half, lambda _: true, 128)  # tiles alone would need 256
    material = textured.visual.material  # type: ignore[union-attr]
    assert max(material.baseColorTexture.size) <= 128
    image, depth_m = MeshView(textured).draw(_CAMERA, sees_half.T_world_cam[0])
    seen = np.s_[25:-25, 10:75]
    assert (depth_m[seen] > 0).all()
    assert psnr_db(image[seen], true[seen] / 255.0) > 32
    view_m = np.eye(4)
    view_m[0, 3] = -0.4
    (of_tiles, _), (of_vertices, _) = (MeshView(m).draw(_CAMERA, view_m) for m in (textured, wall))
    unseen = np.s_[25:-25, 60:80]
    np.testing.assert_allclose(255 * of_tiles[unseen], 255 * of_vertices[unseen], atol=9)


def test_a_texture_too_small_for_a_tenth_of_the_pixels_is_refused_and_the_size_told_suffices():
    def made(most_px: int) -> trimesh.Trimesh:
        sees_half = _sees_half()
        return textured_mesh(_wall(), sees_half, lambda _: _image(_WALL_M), most_px)

    with pytest.raises(UserError, match=r"^--texture-px 8: \d+ parts .* coarser --voxel$") as told:
        made(8)
    needed = int(str(told.value).split("expected ")[1].split()[0])
    material = made(needed).visual.material  # type: ignore[union-attr]
    assert max(material.baseColorTexture.size) <= needed
