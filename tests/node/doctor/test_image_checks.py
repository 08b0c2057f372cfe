"""Registration, motion of the view, repeats, exposure, sharpness and readability, on images made for it."""

import cv2
import numpy as np
import pytest

from hsslam_node.doctor.camera import check_registration
from hsslam_node.doctor.images import (
    check_exposure,
    check_image_size,
    check_readable,
    check_repeated_images,
    check_sharpness,
    check_view_motion,
)
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions

RNG = np.random.default_rng(0)


def boxes(shift_x: int = 0, shift_y: int = 0, size=(480, 640)) -> tuple[np.ndarray, np.ndarray]:
    """Boxes before a wall, each of a colour of its own; colour moved against depth."""
    color, depth = np.full((*size, 3), 90, np.uint8), np.full(size, 3.0, np.float32)
    rng = np.random.default_rng(1)
    for _ in range(25):
        y, x = rng.integers(40, size[0] - 100), rng.integers(40, size[1] - 100)
        h, w = rng.integers(25, 60, 2)
        color[y : y + h, x : x + w] = rng.integers(0, 256, 3)
        depth[y : y + h, x : x + w] = rng.uniform(1.0, 2.5)
    return np.roll(color, (shift_y, shift_x), (0, 1)), depth


def picture() -> np.ndarray:
    return cv2.GaussianBlur(RNG.integers(0, 256, (240, 320, 3), dtype=np.uint8), (0, 0), 2) * 2


@pytest.mark.parametrize(
    ("x", "y", "severity", "words"),
    [
        (0, 0, "ok", ""),
        (8, 0, "fault", "right of"),
        (-8, 0, "fault", "left of"),
        (0, 6, "fault", "below"),
        (0, -15, "fault", "above"),
        (3, 0, "note", "right of"),
    ],
)
def test_registration(x, y, severity, words):
    found = check_registration([boxes(x, y)] * 3)
    assert found.severity == severity
    assert found.value == pytest.approx(max(abs(x), abs(y)), abs=0.6)
    assert words in found.seen


def test_registration_is_in_pixels_of_the_image():
    found = check_registration([boxes(16, 0, size=(960, 1280))] * 3)
    assert (found.severity, found.value) == ("fault", pytest.approx(16, abs=1))


def test_registration_without_edges_cannot_be_told():
    wall = np.full((480, 640, 3), 90, np.uint8), np.full((480, 640), 2.0, np.float32)
    assert (found := check_registration([wall])).severity == "note" and found.value is None
    assert check_registration([]).value is None


@pytest.fixture(scope="module")
def kitchen(test_data) -> list[tuple[np.ndarray, np.ndarray]]:
    """Colour and depth of 20 frames, in m."""
    options = SourceOptions(stride=4, frames=20)
    frames = open_source(f"tum:{test_data / 'kitchen'}", options).frames()
    return [(f.color, f.depth_m()) for f in frames if isinstance(f, Frame)]


def test_depth_of_another_view_lies_on_no_edges_of_colour(kitchen):
    """The control has few edges: in colour, then in depth."""
    mirrored = [(color, depth_m[:, ::-1]) for color, depth_m in kitchen]
    found = check_registration(mirrored)
    assert (found.severity, found.value) == ("fault", 24)
    assert found.seen == "edges of depth lie on no edges of colour within 24 pixels"
    for images in (
        [(color // 20, depth_m) for color, depth_m in mirrored],
        [(color, np.where(np.arange(640) < 560, 2.0, depth_m)) for color, depth_m in mirrored],
    ):
        found = check_registration(images)
        assert (found.severity, found.value) == ("note", None)
        assert "share too few edges" in found.seen


def test_depth_of_another_moment_is_no_good_registration(kitchen):
    """0.3 s late; the words tell what to look for."""
    late = [
        (color, depth_m) for (color, _), (_, depth_m) in zip(kitchen[3:], kitchen, strict=False)
    ]
    found = check_registration(late)
    assert found.severity != "ok"
    assert "both are of the same time" in found.advice


def test_each_frame_of_the_kitchen_alone_is_no_fault(kitchen):
    for images in kitchen:
        assert check_registration([images]).severity != "fault"


@pytest.mark.parametrize(("shift_px", "severity"), [(2, "ok"), (20, "note"), (48, "fault")])
def test_motion_of_the_view(shift_px, severity):
    wide = cv2.resize(RNG.integers(0, 256, (6, 10, 3), dtype=np.uint8), (480, 240))
    pair = wide[:, :320], wide[:, shift_px : shift_px + 320]
    found = check_view_motion([pair] * 4)
    assert found.severity == severity
    assert found.value == pytest.approx(100 * shift_px / 320, rel=0.2)


def test_repeats():
    a, b = picture(), picture()
    assert check_repeated_images([(a, b)] * 9).severity == "ok"
    assert check_repeated_images([(a, b)] * 9 + [(a, a)]).severity == "note"
    assert check_repeated_images([(a, b), (a, a)]).severity == "fault"


def test_exposure():
    a = picture()
    assert check_exposure([a], [(a, a)]).severity == "ok"
    assert check_exposure([a], [(a, a // 2)]).severity == "note"
    assert check_exposure([a // 6], []).severity == "note"
    assert check_exposure([np.zeros_like(a)], []).severity == "fault"


@pytest.mark.parametrize(
    ("width_px", "height_px", "severity"),
    [(640, 480, "ok"), (120, 160, "ok"), (64, 48, "note"), (33, 25, "fault")],
)
def test_image_size(width_px: int, height_px: int, severity: str):
    assert check_image_size(width_px, height_px).severity == severity


def test_sharpness():
    sharp = [picture() for _ in range(4)]
    blurred = [cv2.GaussianBlur(image, (0, 0), 6) for image in sharp]
    assert check_sharpness(sharp).value == 0
    assert check_sharpness(sharp + blurred).severity == "note"


def test_readable():
    assert check_readable(60, []).severity == "ok"
    assert check_readable(59, ["a.png: truncated"]).severity == "note"
    found = check_readable(0, ["a.png: 320x240 pixels: expected 640x480"] * 60)
    assert (found.severity, found.value) == ("fault", 100)
    assert "320x240" in found.seen
