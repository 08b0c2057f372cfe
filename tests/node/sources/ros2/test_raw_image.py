"""Images of ROS in all the encodings that are taken, and in some that are not."""

import cv2
import numpy as np
import pytest

from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.ros2.raw_image import RawImage

RGB = np.random.default_rng(0).integers(0, 256, (6, 5, 3)).astype(np.uint8)
DEPTH = np.random.default_rng(1).integers(0, 9000, (6, 5)).astype(np.uint16)


def raw(pixels: np.ndarray, encoding: str, pad_bytes: int = 0, **fields) -> RawImage:
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
    rows = np.pad(rows, ((0, 0), (0, pad_bytes)), constant_values=7)
    height, width = pixels.shape[:2]
    return RawImage(0, encoding, rows.ravel(), width, height, rows.shape[1], **fields)


@pytest.mark.parametrize("pad", [0, 3])
@pytest.mark.parametrize(
    ("encoding", "channels"),
    [
        ("rgb8", [0, 1, 2]),
        ("bgr8", [2, 1, 0]),
        ("8UC3", [2, 1, 0]),
        ("rgba8", [0, 1, 2, 0]),
        ("bgra8", [2, 1, 0, 0]),
    ],
)
def test_colour(encoding, channels, pad):
    np.testing.assert_array_equal(raw(RGB[..., channels], encoding, pad).color(), RGB)


@pytest.mark.parametrize(
    ("encoding", "code"),
    [
        ("yuv422", cv2.COLOR_RGB2YUV_UYVY),
        ("uyvy", cv2.COLOR_RGB2YUV_UYVY),
        ("yuv422_yuy2", cv2.COLOR_RGB2YUV_YUY2),
        ("yuyv", cv2.COLOR_RGB2YUV_YUY2),
    ],
)
def test_colour_in_yuv(encoding, code):
    blocks = RGB[:, :3].repeat(2, axis=1)  # pairs share their colour, as YUV 4:2:2 keeps it
    image = raw(cv2.cvtColor(blocks, code), encoding, 4)
    assert image.content == "color"
    np.testing.assert_allclose(image.color().astype(int), blocks, atol=4)
    with pytest.raises(BadImageError, match=f"{encoding} of 5x6 pixels: expected an even width"):
        raw(RGB[..., :2], encoding).color()


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_colour_of_a_bayer_sensor(order):
    """Each pixel of the sensor saw one colour; `order`: of a square of 2 x 2, row by row."""
    seen = np.array(["rgb".index(c) for c in order]).reshape(2, 2)
    flat = np.array([200, 100, 50], np.uint8)
    image = raw(np.tile(flat[seen], (4, 4)), f"bayer_{order}8", 3)
    assert image.content == "color"
    np.testing.assert_array_equal(image.color(), np.broadcast_to(flat, (8, 8, 3)))


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_colour_of_a_compressed_bayer_mosaic(order):
    mosaic = np.random.default_rng(2).integers(0, 256, (8, 8)).astype(np.uint8)
    png = cv2.imencode(".png", mosaic)[1]
    image = RawImage(0, f"bayer_{order}8; png compressed ", png, is_compressed=True)
    assert image.content == "color"
    np.testing.assert_array_equal(image.color(), raw(mosaic, f"bayer_{order}8").color())


def test_a_compressed_bayer_image_that_is_converted_stays_as_it_is():
    png = cv2.imencode(".png", RGB[..., ::-1])[1]
    image = RawImage(0, "bayer_rggb8; png compressed bgr8", png, is_compressed=True)
    np.testing.assert_array_equal(image.color(), RGB)


def test_grey_is_the_same_in_all_three():
    grey = RGB[..., 1]
    for image in (raw(grey, "mono8", 1), raw(grey.astype(np.uint16) << 8, "mono16", 2)):
        np.testing.assert_array_equal(image.color(), np.stack(3 * [grey], axis=-1))


@pytest.mark.parametrize("pad", [0, 4])
def test_depth_in_millimetres(pad):
    depth, units = raw(DEPTH, "16UC1", pad).depth()
    np.testing.assert_array_equal(depth, DEPTH)
    assert (units, depth.dtype) == (1000, np.uint16)
    swapped = raw(DEPTH.byteswap(), "16UC1", pad, is_big_endian=True).depth()[0]
    np.testing.assert_array_equal(swapped, DEPTH)


def test_depth_in_floats():
    metres = (DEPTH / 1000).astype(np.float32)
    metres[0] = [np.nan, np.inf, -1.0, 0.0, 40.0]
    depth, units = raw(metres, "32FC1", 4).depth()
    assert (depth[0] == 0).all()
    np.testing.assert_allclose(depth[1:] / units, metres[1:], atol=0.5001 / units)


def test_millimetres_in_floats_are_named():
    far = np.full((4, 5), 20.0, np.float32)  # too far for depth, but metres
    far[0, 0] = 3.0
    assert np.count_nonzero(raw(far, "32FC1", 4).depth()[0]) == 1
    with pytest.raises(BadImageError, match=r"a median of 3000 m: expected metres, or --camera\.d"):
        raw(np.full((4, 5), 3000.0, np.float32), "32FC1", 4).depth()
    depth, units = raw(np.full((4, 5), 3000.0, np.float32), "32FC1", 4).depth(1000.0)
    assert (depth / units == 3.0).all()


def test_compressed():
    png = cv2.imencode(".png", RGB[..., ::-1])[1].ravel()
    color = RawImage(0, "rgb8; png compressed bgr8", png, is_compressed=True).color()
    np.testing.assert_array_equal(color, RGB)
    packed = np.concatenate([np.zeros(12, np.uint8), cv2.imencode(".png", DEPTH)[1].ravel()])
    image = RawImage(0, "16UC1; compressedDepth png", packed, is_compressed=True)
    np.testing.assert_array_equal(image.depth()[0], DEPTH)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: raw(RGB, "bayer_rggb16").color(), "'bayer_rggb16': expected rgb8"),
        (lambda: raw(RGB, "rgb8").depth(), "'rgb8': expected 16UC1"),
        (lambda: RawImage(0, "rgb8", RGB.ravel()[:50], 5, 6, 15).color(), "5x6 pixels in 50 bytes"),
        (lambda: RawImage(0, "rgb8", RGB.ravel(), 5, 6, 14).color(), "at least 15 a row"),
        (lambda: RawImage(0, "rgb8", RGB.ravel(), 0, 0, 0).color(), "0x0 pixels"),
        (lambda: RawImage(0, "jpeg", RGB.ravel(), is_compressed=True).color(), "decoded"),
        (lambda: RawImage(0, "32FC1; x", RGB.ravel(), is_compressed=True).depth(), "a PNG of"),
    ],
)
def test_what_does_not_fit_is_told(make, words):
    with pytest.raises(BadImageError, match=words):
        make()


@pytest.mark.parametrize(
    ("encoding", "content"),
    [
        ("rgb8", "color"),
        ("bgra8", "color"),
        ("mono8", "grey"),
        ("mono16", "depth"),
        ("16UC1", "depth"),
        ("32FC1", "depth"),
        ("bayer_rggb16", "unknown"),
    ],
)
def test_what_an_image_shows_follows_from_its_encoding(encoding, content):
    assert RawImage(0, encoding, np.zeros(0, np.uint8)).content == content


@pytest.mark.parametrize(
    ("encoding", "pixels", "prefix", "content"),
    [
        ("jpeg", RGB, 0, "color"),
        ("mono8; jpeg compressed ", RGB[..., 0], 0, "grey"),
        ("png", RGB, 0, "color"),
        ("png", DEPTH, 0, "depth"),
        ("16UC1; png compressed ", DEPTH, 0, "depth"),
        ("16UC1; compressedDepth png", DEPTH, 12, "depth"),
    ],
)
def test_what_a_compressed_image_shows_follows_from_format_and_file(
    encoding, pixels, prefix, content
):
    file = cv2.imencode(".jpg" if "jpeg" in encoding else ".png", pixels)[1].ravel()
    data = np.concatenate([np.zeros(prefix, np.uint8), file])
    assert RawImage(0, encoding, data, is_compressed=True).content == content
