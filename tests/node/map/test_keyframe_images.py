"""Pixels of keyframes as compressed images."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.map.keyframe_images import KeyframeImages
from tests.small_room import mapped_room


@pytest.fixture(scope="module")
def store():
    return mapped_room().store


@pytest.fixture(scope="module")
def images(store):
    return KeyframeImages.of(store)[1]


def test_depth_comes_back_as_it_was_and_colour_nearly(store, images):
    assert len(images) == store.count
    for k in range(3):
        (color, depth), (expected_color, expected_depth) = images.pixels(k), store.pixels(k)
        np.testing.assert_array_equal(depth, expected_depth)
        difference = np.abs(color.astype(int) - expected_color)
        assert color.shape == expected_color.shape and difference.mean() < 2.0


def test_they_are_smaller_than_the_pixels(store, images):
    color, depth = store.pixels(0)
    assert len(images.color) + len(images.depth) < store.count * (color.nbytes + depth.nbytes) / 2


@pytest.mark.parametrize(
    "changes",
    [
        {"color_end": np.array([5, 4, 9])},
        {"depth_end": np.zeros(3, np.int64)},
        {"depth_end": np.zeros(2, np.int64)},
        {"color": np.zeros(4, np.float32)},
        {"depth_units_per_m": 0.0},
    ],
)
def test_arrays_that_do_not_belong_together_are_refused(images, changes):
    with pytest.raises(ValueError, match=next(iter(changes)).partition("_")[0] + "|JPEGs"):
        replace(images, **changes)


def test_bytes_that_are_no_image_are_told(images):
    broken = replace(images, color=np.zeros_like(images.color))
    with pytest.raises(ValueError, match="keyframe 0: expected a PNG or JPEG"):
        broken.pixels(0)
