"""Headers of images: those that OpenCV writes are read as it decodes them, anything else does no harm."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.image_header import image_header
from hsslam_node.png.encode import encode_png


@settings(max_examples=60)
@given(
    st.integers(1, 70),
    st.integers(1, 70),
    st.sampled_from([(".png", 1, 8), (".png", 3, 8), (".png", 1, 16), (".png", 4, 8)]),
)
def test_a_png_says_what_it_is(width, height, kind):
    suffix, channels, bits = kind
    shape = (height, width) if channels == 1 else (height, width, channels)
    image = np.zeros(shape, np.uint8 if bits == 8 else np.uint16)
    data = cv2.imencode(suffix, image)[1].tobytes()
    header = image_header(data)
    assert header is not None
    found = header.kind, header.width_px, header.height_px, header.channels, header.bits
    assert found == ("png", width, height, channels, bits)
    if channels != 4:
        assert image_header(encode_png(image)) == header


@settings(max_examples=40)
@given(st.integers(1, 70), st.integers(1, 70), st.sampled_from([1, 3]), st.booleans())
def test_a_jpeg_says_what_it_is(width, height, channels, is_progressive):
    shape = (height, width) if channels == 1 else (height, width, channels)
    options = [cv2.IMWRITE_JPEG_PROGRESSIVE, int(is_progressive)]
    data = cv2.imencode(".jpg", np.zeros(shape, np.uint8), options)[1].tobytes()
    exif = b"\xff\xe1\x00\x10Exif" + bytes(10)
    for jpeg in (data, data[:2] + exif + b"\xff" + data[2:]):
        header = image_header(memoryview(jpeg))
        assert header is not None
        assert (header.kind, header.width_px, header.height_px) == ("jpeg", width, height)
        assert (header.channels, header.bits) == (channels, 8)


@given(st.binary(max_size=300), st.sampled_from([b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n"]))
def test_any_bytes_are_a_header_or_none(data, start):
    image_header(start + data)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_header_that_is_cut_short_is_none_or_the_same(suffix):
    data = cv2.imencode(suffix, np.zeros((5, 7, 3), np.uint8))[1].tobytes()
    whole = image_header(data)
    assert {image_header(data[:count]) for count in range(len(data))} <= {None, whole}
