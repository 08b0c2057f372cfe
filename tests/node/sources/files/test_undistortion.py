"""Undistortion of colour and depth."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.undistortion import Undistortion

LENS = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
RATIONAL = (
    0.45,
    -2.6,
    4e-4,
    -3e-4,
    1.5,
    0.33,
    -2.4,
    1.42,
)  # as Azure Kinect's colour camera has it
PRISM = (*RATIONAL, 2e-3, -1e-3, 1e-3, -2e-3)
K = (517.3, 516.5, 318.6, 255.3)
CAMERA = Camera(640, 480, *K, LENS)
CAMERAS = {
    "4": Camera(640, 480, *K, LENS[:4]),
    "5": CAMERA,
    "8": Camera(640, 480, *K, RATIONAL),
    "12": Camera(640, 480, *K, PRISM),
    "14": Camera(640, 480, *K, (*PRISM, 0.01, -0.02)),
    "equidistant": Camera(640, 480, *K, (0.05, -0.02, 0.01, -0.003), "equidistant"),
    "ideal fisheye": Camera(640, 480, *K, (0.0, 0.0, 0.0, 0.0), "equidistant"),
}
UNDISTORTIONS = {name: Undistortion(camera) for name, camera in CAMERAS.items()}


def test_without_distortion_nothing_is_touched():
    undistortion = Undistortion(CAMERA.undistorted())
    depth = np.zeros((480, 640), np.uint16)
    assert undistortion.depth(depth) is depth


@pytest.mark.parametrize("camera", [CAMERA, CAMERA.undistorted()])
def test_images_of_another_size_are_refused(camera):
    """They would be cropped to the size of the camera."""
    undistortion = Undistortion(camera)
    with pytest.raises(UserError, match="colour has 1280 x 720 px: expected 640 x 480 px"):
        undistortion.color(np.zeros((720, 1280, 3), np.uint8))
    with pytest.raises(UserError, match="depth has 320 x 240 px: expected 640 x 480 px"):
        undistortion.depth(np.zeros((240, 320), np.uint16))


def seen_by(camera: Camera, pixels: np.ndarray) -> np.ndarray:
    """Where the lens puts the rays of pinhole pixels [N, 2]: [N, 2]."""
    rays = np.column_stack(
        [(pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(len(pixels))]
    )
    project = (
        cv2.fisheye.projectPoints if camera.distortion_model == "equidistant" else cv2.projectPoints
    )
    args = (np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion))
    return project(rays[:, None], *args)[0].reshape(-1, 2)


def pattern(pixels: np.ndarray) -> np.ndarray:
    """Smooth colour [N] float of a plane at pinhole pixels [N, 2]."""
    return 128 + 60 * np.sin(pixels[:, 0] / 23) + 60 * np.cos(pixels[:, 1] / 17)


@pytest.mark.parametrize("name", CAMERAS)
def test_the_image_of_a_lens_becomes_that_of_a_pinhole(name):
    """The lens's image is drawn, in its middle, by inverting the projection of the lens by iteration."""
    camera = CAMERAS[name]
    middle = (slice(70, 410), slice(95, 545))
    v, u = np.indices((480, 640))[:, *middle]
    drawn = np.stack([u, v], axis=-1).reshape(-1, 2).astype(float)
    pinhole = drawn.copy()  # the pinhole pixels that the lens puts at the pixels that are drawn
    left = np.arange(len(drawn))  # pixels that have not converged
    for _ in range(15):
        off = drawn[left] - seen_by(camera, pinhole[left])
        pinhole[left] += 0.7 * off
        left = left[np.abs(off).max(axis=1) > 0.01]
        if not left.size:
            break
    converged = np.abs(seen_by(camera, pinhole) - drawn).max(axis=1) < 0.01
    distorted = np.zeros((480, 640), np.uint8)
    distorted[middle] = np.where(converged, np.rint(pattern(pinhole)), 0).reshape(u.shape)
    depth = (5000 + 10 * distorted.astype(np.uint16)).astype(np.uint16)
    color = UNDISTORTIONS[name].color(np.repeat(distorted[..., None], 3, axis=2))
    plain = pattern(np.indices((480, 640))[::-1].reshape(2, -1).T).reshape(480, 640)
    inner = (slice(90, 390), slice(120, 520))
    assert np.abs(color[..., 0][inner] - plain[inner]).max() < 3
    nearest = (UNDISTORTIONS[name].depth(depth).astype(float) - 5000) / 10
    assert np.abs(nearest[inner] - plain[inner]).max() < 6  # half a pixel off
    moved = np.abs(distorted.astype(float)[inner] - plain[inner]).max()
    assert moved > 10  # the lens does something here


@given(st.sampled_from(sorted(CAMERAS)), st.integers(120, 520), st.integers(90, 390))
def test_a_point_lands_where_a_pinhole_would_have_put_it(name, u, v):
    """A dot drawn where the lens puts a ray comes out at the ray's pinhole pixel, to a pixel."""
    x, y = np.rint(seen_by(CAMERAS[name], np.array([[u, v]], float))[0]).astype(int)
    depth, color = np.zeros((480, 640), np.uint16), np.zeros((480, 640, 3), np.uint8)
    depth[y - 1 : y + 2, x - 1 : x + 2] = 7000
    color[y - 1 : y + 2, x - 1 : x + 2] = 255
    assert UNDISTORTIONS[name].depth(depth)[v, u] == 7000
    assert UNDISTORTIONS[name].color(color)[v, u, 0] > 100


@pytest.mark.parametrize("name", ["4", "5"])
def test_few_coefficients_give_the_images_of_the_maps_of_opencv(name):
    camera = CAMERAS[name]
    rng = np.random.default_rng(0)
    color = rng.integers(0, 256, (480, 640, 3), np.uint8)
    maps = cv2.initUndistortRectifyMap(
        camera.K, np.array(camera.distortion), np.eye(3), camera.K, (640, 480), cv2.CV_32FC1
    )
    fixed = cv2.convertMaps(*maps, cv2.CV_16SC2)
    expected = cv2.remap(color, *fixed, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    np.testing.assert_array_equal(UNDISTORTIONS[name].color(color), expected)


@pytest.mark.parametrize("name", CAMERAS)
def test_depth_of_two_surfaces_is_never_mixed(name):
    depth = np.where(np.indices((480, 640)).sum(axis=0) % 7 < 3, 5000, 20000).astype(np.uint16)
    assert set(np.unique(UNDISTORTIONS[name].depth(depth))) <= {0, 5000, 20000}


@pytest.mark.parametrize("name", ["5", "8", "14"])
def test_depth_of_a_slanted_wall_is_good_to_a_unit(name):
    camera = CAMERAS[name]
    v, u = np.indices((480, 640)).reshape(2, 1, -1)
    lens = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(float)
    rays = cv2.undistortPoints(lens, camera.K, np.array(camera.distortion)).reshape(-1, 2)

    def wall(x: np.ndarray) -> np.ndarray:
        return 8000 / (1 + 0.8 * x)

    seen = np.rint(wall(rays[:, 0])).reshape(480, 640).astype(np.uint16)
    x = (np.arange(640) - camera.cx) / camera.fx
    off = UNDISTORTIONS[name].depth(seen) - np.rint(wall(x))[None, :]
    assert np.abs(off[60:420, 80:560]).max() <= 1.0
    nearest = seen[60:420, 80:560] - np.rint(wall(x))[None, 80:560]
    assert np.abs(nearest).max() > 10  # the lens does something here


def test_where_no_pixel_is_depth_is_0_and_colour_goes_on():
    barrel = Camera(640, 480, *K, (0.3, 0.0, 0.0, 0.0))  # the corners of the pinhole lie outside
    undistortion = Undistortion(barrel)
    depth = undistortion.depth(np.full((480, 640), 5000, np.uint16))
    assert depth[0, 0] == depth[-1, -1] == 0 and depth[240, 320] == 5000
    assert undistortion.color(np.full((480, 640, 3), 90, np.uint8)).min() == 90


@given(st.integers(0, 16), st.sampled_from(["opencv", "equidistant"]))
def test_other_counts_are_named(count, model):
    lens = count * (0.1,)
    if count in ({4} if model == "equidistant" else {0, 4, 5, 8, 12, 14}):
        assert Camera(640, 480, *K, lens, model).scaled(0.5).distortion == lens
        return
    with pytest.raises(
        UserError, match=rf"camera\.distortion = .*\({count} numbers\): expected "
    ) as error:
        Camera(640, 480, *K, lens, model)
    assert "\n" not in str(error.value)
