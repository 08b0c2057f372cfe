"""What can be tested of a RealSense camera without one."""

import importlib.util
from types import SimpleNamespace

import pytest

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.cameras.realsense import JoinedSets, realsense_camera
from hsslam_node.sources.options.camera import RealsenseOptions
from hsslam_services.camera.open_source import check_source_exists, open_any_source
from hsslam_services.run.options import ServeOptions


def test_without_package_or_camera_it_is_one_line():
    missing = importlib.util.find_spec("pyrealsense2") is None
    words = r"pip install 'hsslam-node\[realsense\]'" if missing else "no camera: expected"
    for look in (
        lambda: open_any_source("realsense"),
        lambda: check_source_exists(ServeOptions("realsense")),
    ):
        with pytest.raises(UserError, match=words):
            look()


def test_a_wrong_name_suggests_the_right_one():
    with pytest.raises(UserError, match="did you mean realsense"):
        check_source_exists(ServeOptions("realsense:1"))


def test_its_intrinsics():
    given = SimpleNamespace(
        width=640, height=480, fx=610.5, fy=611.0, ppx=321.0, ppy=242.5, coeffs=[0.0] * 5
    )
    assert realsense_camera(given) == Camera(640, 480, 610.5, 611.0, 321.0, 242.5)
    given.coeffs = [0.1, -0.2, 0.0, 0.001, 0.05]
    assert realsense_camera(given).distortion == (0.1, -0.2, 0.0, 0.001, 0.05)


@pytest.mark.parametrize("field", ["width_px", "height_px", "rate_hz"])
def test_wrong_options_are_named(field):
    with pytest.raises(UserError, match=f"--realsense.{field.replace('_', '-')} 0: expected"):
        RealsenseOptions(**{field: 0})


def _image(stamp_ms: float, clock: str = "hardware") -> SimpleNamespace:
    return SimpleNamespace(get_timestamp=lambda: stamp_ms, get_frame_timestamp_domain=lambda: clock)


def test_a_set_that_the_library_filled_with_an_older_image_is_no_frame():
    """As librealsense 2.59 gave them: depth at 30 Hz, colour at 15 Hz; then an image of depth is missing."""
    sets = JoinedSets(30)
    given = ((2, 1), (2, 2), (2, 3), (4, 3), (4, 4), (4, 5), (6, 6), (7, 6), (8, 8))
    faults = [sets.fault(_image(33.3 * color), _image(33.3 * depth)) for color, depth in given]
    assert [pair for pair, fault in zip(given, faults, strict=True) if not fault] == [
        (2, 2), (4, 4), (6, 6), (8, 8),
    ]  # fmt: skip
    assert len(set(faults)) == 2 and "not of the same time" in max(
        faults
    )  # one reason, to be counted


def test_colour_and_depth_of_a_free_running_camera_or_of_two_clocks_are_frames():
    sets = JoinedSets(30)
    assert not sets.fault(_image(0.0), _image(16.7)) and not sets.fault(_image(33.3), _image(50.0))
    assert not sets.fault(_image(66.6, "system"), _image(9e12))
    assert sets.fault(_image(66.6, "system"), _image(9e12 + 33))  # the same image of colour
