"""compressedDepth in RVL and of floats, written from the encoders' sources, without the decoder's code."""

import struct

import cv2
import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.ros2.compressed_depth import rvl_depth
from hsslam_node.sources.ros2.raw_image import RawImage

_RVL = "16UC1; compressedDepth rvl"


def _rvl(depth: np.ndarray, header: bytes = bytes(12)) -> np.ndarray:
    """As `CompressRVL` of rvl_codec.cpp, number by number."""
    nibbles: list[int] = []

    def put(value: int) -> None:
        while True:
            low, value = value & 7, value >> 3
            nibbles.append(low | (8 if value else 0))
            if not value:
                return

    pixels, previous = [int(value) for value in depth.ravel()], 0
    at = 0
    while at < len(pixels):
        for is_zero in (True, False):
            begin = at
            while at < len(pixels) and (pixels[at] == 0) == is_zero:
                at += 1
            put(at - begin)
        for value in pixels[begin:at]:
            delta, previous = value - previous, value
            put((delta << 1) ^ (delta >> 31))
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        int("".join(f"{n:x}" for n in nibbles[k : k + 8]), 16) for k in range(0, len(nibbles), 8)
    ]
    size = struct.pack("<II", depth.shape[1], depth.shape[0])
    return np.frombuffer(header + size + struct.pack(f"<{len(words)}I", *words), np.uint8)


def _depths() -> list[np.ndarray]:
    rng = np.random.default_rng(0)
    smooth = (1000 + 3 * np.arange(80)[None] + np.arange(60)[:, None]).astype(np.uint16)
    holes = np.where(rng.random((60, 80)) < 0.3, 0, rng.integers(1, 65536, (60, 80)))
    edges = np.zeros((3, 5), np.uint16)
    edges[1, 2:] = 65535, 1, 9
    return [smooth, holes.astype(np.uint16), edges, np.zeros((4, 6), np.uint16), smooth[:1, :1]]


@pytest.mark.parametrize("depth", _depths())
def test_rvl(depth: np.ndarray):
    image = RawImage(0, _RVL, _rvl(depth), is_compressed=True)
    assert image.content == "depth"
    found, units = image.depth()
    np.testing.assert_array_equal(found, depth)
    assert (found.dtype, units) == (np.uint16, 1000.0)
    image.expect_size(Camera(*depth.shape[::-1], 50.0, 50.0, 2.0, 1.0))
    with pytest.raises(BadImageError, match=r"depth in RVL of .* pixels: expected 9x9 as before"):
        image.expect_size(Camera(9, 9, 50.0, 50.0, 4.0, 4.0))


def test_known_bytes_of_rvl():
    """No zeros, two pixels: 1000 (step 2000 = 0b11_111_010_000) and 1001 (step 2)."""
    word = 0x028A_F320.to_bytes(4, "little")
    data = np.frombuffer(bytes(12) + struct.pack("<II", 2, 1) + word, np.uint8)
    assert rvl_depth(data, 100).tolist() == [[1000, 1001]]


@pytest.mark.parametrize("kept", [10, 19, 20, 24, 200])
def test_rvl_that_is_cut_off_is_told(kept: int):
    whole = _rvl(_depths()[1])
    with pytest.raises(BadImageError, match=r"depth in RVL of .*: (cut off|expected)"):
        RawImage(0, _RVL, whole[:kept], is_compressed=True).depth()


def test_noise_as_rvl_is_told_and_takes_no_memory():
    rng = np.random.default_rng(0)
    for _ in range(200):
        size = struct.pack("<II", 80, 60)
        for noise in (
            rng.bytes(400),
            rng.bytes(2) + b"\xff" * 398,
        ):  # the second is one long number
            data = np.frombuffer(bytes(12) + size + noise, np.uint8)
            with pytest.raises(BadImageError):
                rvl_depth(data, 100_000)
    with pytest.raises(BadImageError, match="4294967295x4294967295 pixels: expected 1 to"):
        rvl_depth(np.full(100, 255, np.uint8), 100_000)


@pytest.mark.parametrize("form", ["png", "rvl"])
def test_floats_as_inverse_depth(form: str):
    """As `encodeCompressedDepthImage` of codec.cpp: depth_max 10 m, depth_quantization 100."""
    metres = np.random.default_rng(0).uniform(0.5, 9.5, (60, 80)).astype(np.float32)
    a = 100.0 * 101.0
    b = 1.0 - a / 10.0
    inverse = (a / metres + b).astype(np.uint16)
    inverse[0] = 0
    header = struct.pack("<iff", 0, a, b)
    png = np.frombuffer(header + cv2.imencode(".png", inverse)[1].tobytes(), np.uint8)
    data = png if form == "png" else _rvl(inverse, header)
    image = RawImage(
        0, f"32FC1; compressedDepth {form}".removesuffix(" png"), data, is_compressed=True
    )
    depth, units = image.depth()
    assert not depth[0].any()
    error_m = np.abs(depth[1:] / units - metres[1:])
    assert (error_m <= metres[1:] ** 2 / (a - metres[1:]) + 1e-3).all()  # a step of inverse depth
