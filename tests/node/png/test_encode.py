"""PNG files of our writer, read by OpenCV's."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hsslam_node.png.encode import encode_png

_IMAGES = st.sampled_from([np.uint8, np.uint16]).flatmap(
    lambda dtype: hnp.arrays(
        dtype,
        st.tuples(st.integers(1, 24), st.integers(1, 24), st.sampled_from([0, 3])).map(
            lambda shape: shape if shape[2] else shape[:2]
        ),
    )
)


@settings(deadline=None)
@given(_IMAGES)
def test_opencv_reads_the_same_pixels(image):
    read = cv2.imdecode(np.frombuffer(encode_png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    expected = image[..., ::-1] if image.ndim == 3 else image
    assert read.dtype == image.dtype
    np.testing.assert_array_equal(read, expected)


def test_a_view_is_read_as_what_it_shows():
    image = np.arange(5 * 8, dtype=np.uint16).reshape(5, 8)[:, ::2]
    read = cv2.imdecode(np.frombuffer(encode_png(image), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, image)


@pytest.mark.parametrize(
    "image", [np.zeros((4, 4), np.float32), np.zeros((4, 4, 4), np.uint8), np.zeros(4, np.uint8)]
)
def test_other_images_are_refused(image):
    with pytest.raises(ValueError, match=r"expected \[H, W\]"):
        encode_png(image)
