"""Decoding: whatever is wrong with a file is told, never guessed."""

import time

import cv2
import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import (
    BadImageError,
    read_any_color,
    read_any_depth,
    read_color,
    read_depth,
)
from tests.claimed_image import png_that_claims

CAMERA = Camera(32, 24, 30.0, 30.0, 15.5, 11.5)
RNG = np.random.default_rng(0)
COLOR = RNG.integers(0, 256, (24, 32, 3), np.uint8)
DEPTH = RNG.integers(0, 65536, (24, 32), np.uint16)


def test_png_comes_back_exactly_and_in_rgb(tmp_path):
    cv2.imwrite(str(tmp_path / "c.png"), COLOR[..., ::-1])
    cv2.imwrite(str(tmp_path / "d.png"), DEPTH)
    np.testing.assert_array_equal(read_color(tmp_path / "c.png", CAMERA), COLOR)
    np.testing.assert_array_equal(read_depth(tmp_path / "d.png", CAMERA), DEPTH)


@pytest.mark.parametrize("name", ["c.jpg", "c.png", "d.png"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 0.98])
def test_a_truncated_file_is_refused(tmp_path, name, share):
    path = tmp_path / name
    cv2.imwrite(str(path), COLOR if name[0] == "c" else DEPTH)
    data = path.read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(BadImageError, match=name):
        (read_color if name[0] == "c" else read_depth)(path, CAMERA)


@pytest.mark.parametrize("progressive", [0, 1])
def test_a_jpeg_is_whole_whatever_follows_its_end(tmp_path, progressive):
    """As phones and padding writers make it; the control is cut off, and has a whole thumbnail inside."""
    path, plain = tmp_path / "c.jpg", tmp_path / "plain.jpg"
    how = [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive]
    assert cv2.imwrite(str(plain), COLOR[..., ::-1], how)
    data = plain.read_bytes()
    inside = b"\xff\xe1" + (2 + len(data)).to_bytes(2, "big") + data
    data = data[:2] + inside + data[2:]
    for rest in (b"\0" * 400, b"text" * 1000):
        path.write_bytes(data + rest)
        np.testing.assert_array_equal(read_color(path, CAMERA), read_color(plain, CAMERA))
        path.write_bytes(data[:-100] + rest)
        with pytest.raises(BadImageError, match="truncated at"):
            read_color(path, CAMERA)


def test_a_corrupt_png_is_refused(tmp_path):
    path = tmp_path / "d.png"
    cv2.imwrite(str(path), DEPTH)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(BadImageError):
        read_depth(path, CAMERA)


@pytest.mark.parametrize("read", [read_color, read_depth, read_any_color, read_any_depth])
def test_an_image_that_claims_gigabytes_is_refused_by_its_header(tmp_path, read):
    path = tmp_path / "large.png"
    path.write_bytes(png_that_claims(16384, 16384))
    camera = () if "any" in read.__name__ else (CAMERA,)
    begin_s = time.process_time()
    with pytest.raises(BadImageError, match="16384x16384 pixels: expected at most 67108864 in all"):
        read(path, *camera)
    assert time.process_time() - begin_s < 0.2


def test_missing_wrong_size_wrong_depth(tmp_path):
    with pytest.raises(BadImageError, match="No such file"):
        read_color(tmp_path / "none.png", CAMERA)
    cv2.imwrite(str(tmp_path / "small.png"), DEPTH[:12])
    with pytest.raises(BadImageError, match="32x12 pixels: expected 32x24"):
        read_depth(tmp_path / "small.png", CAMERA)
    cv2.imwrite(str(tmp_path / "eight.png"), COLOR)
    with pytest.raises(BadImageError, match="8 bit, 3 channels"):
        read_depth(tmp_path / "eight.png", CAMERA)
