"""Depth of a depth camera in the pixels of the colour camera beside it."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, transform
from hsslam_node.sources.files.depth_registration import DepthRegistration
from tests.node.sources.files.two_cameras import (
    COLOR,
    DEPTH,
    T_COLOR_DEPTH,
    expect_registered,
    seen_room,
)

_UNITS_PER_M = 5000.0
_SIDEWAYS = transform(np.array([0.05, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
_small = st.floats(-1.0, 1.0)


def _plane(camera: Camera, T_world_cam: np.ndarray, tilt: tuple[float, float]) -> np.ndarray:
    """Depth [H, W], metres, of the plane z = 2 + tilt . (x, y) in the world."""
    rows, columns = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)], -1
    )
    normal = np.array([-tilt[0], -tilt[1], 1.0])
    R, t = T_world_cam[:3, :3], T_world_cam[:3, 3]
    return (2.0 - normal @ t) / (rays @ R.T @ normal)


@pytest.mark.parametrize("units_per_m", [1000.0, _UNITS_PER_M, 10000.0])
def test_a_room_seen_by_two_cameras(units_per_m: float):
    """The control is what the first step alone gives."""
    registration = DepthRegistration(DEPTH, COLOR, T_COLOR_DEPTH, units_per_m)
    for seen in seen_room(units_per_m, rows=(10, 60)):
        found = registration.registered(seen.depth_raw)
        expect_registered(found, seen.exact, units_per_m)
        millimetres = (seen.depth_raw * (1000.0 / units_per_m)).astype(np.uint16)
        first = cv2.registerDepth(
            DEPTH.K,
            COLOR.K,
            np.zeros(4),
            T_COLOR_DEPTH,
            millimetres,
            (160, 120),
            depthDilation=True,
        )
        errors_m = [
            np.abs(depth / units - seen.exact / units_per_m)[(depth > 0) & (seen.exact > 0)]
            for depth, units in ((found, units_per_m), (first, 1000.0))
        ]
        assert np.median(errors_m[0]) < 0.25 * np.median(errors_m[1])
        assert np.mean(errors_m[0] > 0.02) < np.mean(errors_m[1] > 0.02)


@settings(max_examples=30)
@given(turn_deg=st.tuples(_small, _small, _small), move=st.tuples(_small, _small, _small),
       tilt=st.tuples(_small, _small))  # fmt: skip
def test_a_plane_stays_the_plane(turn_deg, move, tilt):
    turn = Rotation.from_euler("xyz", 2.0 * np.array(turn_deg), degrees=True)
    T_color_depth = transform(0.05 * np.array(move), turn.as_quat())
    tilt = (0.2 * tilt[0], 0.2 * tilt[1])
    depth_raw = np.rint(_UNITS_PER_M * _plane(DEPTH, T_color_depth, tilt)).astype(np.uint16)
    found = DepthRegistration(DEPTH, COLOR, T_color_depth, _UNITS_PER_M).registered(depth_raw)
    error = found - _UNITS_PER_M * _plane(COLOR, np.eye(4), tilt)
    assert np.mean(found > 0) > 0.9
    assert np.abs(error[found > 0]).max() < 2.5  # units: half a millimetre


@pytest.mark.parametrize(
    ("depth", "color"),
    [  # width, height, focal length: profiles of cameras, at a quarter of their size
        ((212, 120, 106), (320, 180, 229)),  # D435, colour of 1280x720
        ((212, 120, 106), (480, 270, 343)),  # and of 1920x1080
        ((160, 120, 96), (320, 180, 229)),
        ((320, 180, 159), (160, 120, 152)),  # depth of more rows and columns than colour
        ((256, 192, 181), (320, 180, 229)),  # L515: of more rows
        ((212, 120, 106), (160, 120, 152)),  # of more columns
        ((128, 106, 91), (480, 270, 270)),  # Kinect v2
    ],
)
def test_cameras_of_any_size(depth, color):
    """A plane has depth in all pixels of colour that look at its image, but at the border."""
    of_depth, of_color = (
        Camera(w, h, float(f), float(f), (w - 1) / 2, (h - 1) / 2) for w, h, f in (depth, color)
    )
    depth_raw = np.rint(_UNITS_PER_M * _plane(of_depth, _SIDEWAYS, (0.1, 0.1))).astype(np.uint16)
    found = DepthRegistration(of_depth, of_color, _SIDEWAYS, _UNITS_PER_M).registered(depth_raw)
    exact_m = _plane(of_color, np.eye(4), (0.1, 0.1))
    rows, columns = np.mgrid[: of_color.height_px, : of_color.width_px]
    points = np.stack([(columns - of_color.cx), (rows - of_color.cy)]) * exact_m / of_color.fx
    u, v = of_depth.fx * (points - _SIDEWAYS[:2, 3, None, None]) / exact_m
    half = np.array([of_depth.width_px, of_depth.height_px]) / 2 - 4
    inside = (np.abs(u) < half[0]) & (np.abs(v) < half[1])
    assert inside.sum() > 2000 and (found[inside] > 0).all()
    assert np.abs(found - _UNITS_PER_M * exact_m)[inside].max() < 2.5


def test_the_same_camera_changes_nothing():
    (seen,) = seen_room(_UNITS_PER_M, rows=(20,))
    found = DepthRegistration(DEPTH, DEPTH, np.eye(4), _UNITS_PER_M).registered(seen.depth_raw)
    np.testing.assert_array_equal(found, seen.depth_raw)


def test_of_two_surfaces_the_nearer_one_is_seen_and_gaps_stay():
    """A board half a metre away hides another part of the wall from each camera."""
    depth_raw = np.full((120, 160), 3 * _UNITS_PER_M, np.uint16)
    depth_raw[40:80, 60:100] = round(0.5 * _UNITS_PER_M)
    depth_raw[100:, :50] = 0
    found = DepthRegistration(COLOR, COLOR, _SIDEWAYS, _UNITS_PER_M).registered(depth_raw)
    near, far = (round(m * 0.05 * COLOR.fx) for m in (1 / 0.5, 1 / 3))  # pixels that each moves
    assert (near, far) == (15, 3)
    assert (found[42:78, 60 + near + 1 : 100 + near - 1] == round(0.5 * _UNITS_PER_M)).all()
    assert (found[42:78, 5:55] == 3 * _UNITS_PER_M).all()
    assert (found[102:, : 50 + far - 2] == 0).all()


def test_what_comes_out_behind_the_colour_camera_is_gone():
    T_color_depth = transform(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    depth_raw = np.full((120, 160), round(0.9 * _UNITS_PER_M), np.uint16)
    found = DepthRegistration(DEPTH, COLOR, T_color_depth, _UNITS_PER_M).registered(depth_raw)
    assert not found.any()


def test_depth_of_the_wrong_size_is_an_error():
    registration = DepthRegistration(DEPTH, COLOR, inverse(T_COLOR_DEPTH), _UNITS_PER_M)
    with pytest.raises(UserError, match=r"depth has 80 x 60 px: expected 160 x 120 px"):
        registration.registered(np.zeros((60, 80), np.uint16))


def test_65535_is_no_depth_in_the_depth_camera_either():
    turned = transform(np.zeros(3), Rotation.from_euler("y", 1.0, degrees=True).as_quat())
    registration = DepthRegistration(DEPTH, COLOR, turned, _UNITS_PER_M)
    nothing = np.full((DEPTH.height_px, DEPTH.width_px), 65535, np.uint16)
    assert not registration.registered(nothing).any()
