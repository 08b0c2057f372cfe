"""PNG read by our reader as by OpenCV's, or left to it."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hsslam_node.png.decode import decode_png
from hsslam_node.png.encode import encode_png

SIDE = st.integers(1, 24)
DEPTH = hnp.arrays(np.uint16, st.tuples(SIDE, SIDE))
COLOR = hnp.arrays(np.uint8, st.tuples(SIDE, SIDE, st.just(3)))
NONE, SUB, UP, AVERAGE, PAETH = range(5)


def chunk(kind: bytes, content: bytes) -> bytes:
    checksum = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + checksum


def png_of_rows(rows: np.ndarray, width: int, bits: int, color_type: int) -> bytes:
    """A PNG of filtered rows [H, 1 + N] uint8."""
    header = struct.pack(">IIBBBBB", width, len(rows), bits, color_type, 0, 0, 0)
    content = zlib.compress(rows.tobytes())
    parts = content[: len(content) // 2], content[len(content) // 2 :]
    return b"".join(
        [
            b"\x89PNG\r\n\x1a\n",
            chunk(b"IHDR", header),
            *[chunk(b"IDAT", part) for part in parts],
            chunk(b"IEND", b""),
        ]
    )


def by_opencv(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image[..., ::-1] if image.ndim == 3 else image


@settings(deadline=None)
@given(st.one_of(DEPTH, COLOR))
def test_it_reads_what_our_writer_and_opencvs_have_written(image):
    bgr = image[..., ::-1] if image.ndim == 3 else image
    for data in (encode_png(image), cv2.imencode(".png", bgr)[1].tobytes()):
        read = decode_png(data)
        assert read is not None and read.dtype == image.dtype
        np.testing.assert_array_equal(read, image)


@settings(deadline=None)
@given(st.data(), SIDE, SIDE, st.sampled_from([(8, 2, 3), (16, 0, 2)]))
def test_all_filters_are_undone_as_opencv_does_it(data, height, width, kind):
    bits, color_type, step = kind
    rows = data.draw(hnp.arrays(np.uint8, (height, 1 + step * width)))
    rows[:, 0] = data.draw(hnp.arrays(np.uint8, height, elements=st.integers(NONE, PAETH)))
    packed = png_of_rows(rows, width, bits, color_type)
    read = decode_png(packed)
    assert read is not None
    np.testing.assert_array_equal(read, by_opencv(packed))


@pytest.mark.parametrize(
    "image",
    [np.zeros((4, 5), np.uint8), np.zeros((4, 5, 3), np.uint16), np.zeros((4, 5, 4), np.uint8)],
    ids=["grey of 8 bit", "colour of 16 bit", "transparent"],
)
def test_other_pixels_are_left_to_opencv(image):
    assert decode_png(cv2.imencode(".png", image)[1].tobytes()) is None


def test_a_palette_is_left_to_opencv():
    packed = png_of_rows(np.zeros((2, 1 + 3), np.uint8), 3, 8, 3)
    header_end = 33
    colors = chunk(b"PLTE", bytes(3))
    assert decode_png(packed[:header_end] + colors + packed[header_end:]) is None


def test_chunks_that_may_change_pixels_are_left_to_opencv():
    packed = encode_png(np.ones((4, 5, 3), np.uint8))
    header_end = 33
    for kind, is_ours in ((b"tEXt", True), (b"eXIf", True), (b"tRNS", False), (b"acTL", False)):
        content = chunk(kind, b"\x00\x01\x00\x01\x00\x01")
        read = decode_png(packed[:header_end] + content + packed[header_end:])
        assert (read is not None) is is_ours, kind


@settings(deadline=None)
@given(DEPTH, st.data())
def test_a_damaged_file_is_never_read_as_something_else(image, data):
    packed = bytearray(encode_png(image))
    at = data.draw(st.integers(0, len(packed) - 1))
    packed[at] ^= data.draw(st.integers(1, 255))
    assert decode_png(bytes(packed)) is None
    assert decode_png(bytes(packed[:at])) is None


def test_rows_beyond_those_of_the_header_take_no_memory():
    rows = np.zeros((50_000, 1 + 2 * 500), np.uint8)  # 50 MB
    packed = bytearray(png_of_rows(rows, 500, 16, 0))
    for width, height in ((500, 4), (2**31 - 1, 2**31 - 1)):
        header = struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0)
        packed[8:33] = chunk(b"IHDR", header)
        assert decode_png(bytes(packed)) is None
    assert decode_png(png_of_rows(rows[:3], 500, 16, 0)[:-12]) is None  # no end


def test_a_filter_that_there_is_not_is_no_image():
    rows = np.full((2, 1 + 2 * 3), 5, np.uint8)
    assert decode_png(png_of_rows(rows, 3, 16, 0)) is None
