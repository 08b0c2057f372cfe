"""Images decoded: by our reader or OpenCV's, with the same pixels."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image

from hsslam_node.image_decoding import decoded_as_stored, decoded_mask, decoded_rgb

ORIENTATION = 274  # tag of EXIF
RNG = np.random.default_rng(0)
RGB = RNG.integers(0, 255, (12, 17, 3), np.uint8)
DEPTH = RNG.integers(0, 65535, (12, 17), np.uint16)


def packed(image: np.ndarray, suffix: str = ".png") -> np.ndarray:
    return cv2.imencode(suffix, image)[1]


@pytest.mark.parametrize(
    "image",
    [RGB, RGB[..., 0], DEPTH, RGB.astype(np.uint16) * 257, np.dstack([RGB, RGB[..., 0]])],
    ids=["colour", "grey", "grey of 16 bit", "colour of 16 bit", "transparent"],
)
@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_colour_is_what_opencv_reads(image, suffix):
    data = packed(image, suffix)
    expected = cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1]
    for given in (data, data.tobytes(), memoryview(data.tobytes())):
        read = decoded_rgb(given)
        assert read is not None and read.dtype == np.uint8
        np.testing.assert_array_equal(read, expected)


@pytest.mark.parametrize("form", ["JPEG", "PNG"])
def test_the_tag_that_turns_a_picture_for_people_is_ignored(form):
    tags, file = Image.Exif(), io.BytesIO()
    tags[ORIENTATION] = 6  # turned by 90 degrees
    Image.fromarray(RGB).save(file, form, exif=tags, quality=100, subsampling=0)
    read, mask = decoded_rgb(file.getvalue()), decoded_mask(file.getvalue())
    assert read is not None and mask is not None
    assert mask.shape == RGB.shape
    np.testing.assert_allclose(read.astype(int), RGB, atol=0 if form == "PNG" else 12)


def test_depth_is_as_stored():
    for suffix in (".png", ".tiff"):
        np.testing.assert_array_equal(decoded_as_stored(packed(DEPTH, suffix)), DEPTH)


def test_a_mask_keeps_its_16_bits():
    read = decoded_mask(packed(DEPTH))
    assert read is not None
    np.testing.assert_array_equal(read, np.dstack([DEPTH] * 3))


def test_no_image_is_none():
    for data in (b"", b"text", packed(RGB).tobytes()[:40], packed(DEPTH)[:40]):
        assert decoded_rgb(data) is decoded_as_stored(data) is decoded_mask(data) is None
