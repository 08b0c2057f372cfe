"""A camera takes what OpenCV's calibration returns, and refuses the rest in one line."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera

_PINHOLE = (640, 480, 525.0, 525.0, 319.5, 239.5)
_LENS = (-0.25, 0.06, 0.001, -0.002)


@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (4,)])
@pytest.mark.parametrize("model", ["opencv", "equidistant"])
def test_coefficients_may_be_an_array_of_a_calibration(shape, model):
    array = np.reshape(_LENS, shape)
    assert Camera(*_PINHOLE, array, model) == Camera(*_PINHOLE, _LENS, model)


def test_no_coefficients_are_no_lens():
    assert Camera(*_PINHOLE, None) == Camera(*_PINHOLE, np.zeros((0, 1))) == Camera(*_PINHOLE)


@pytest.mark.parametrize("distortion", ["abcd", 0.1, (1, 2, 3), (1, [2], 3, 4), np.eye(3), {}])
def test_what_is_no_lens_is_one_line(distortion):
    with pytest.raises(UserError, match=r"^camera\.distortion = .*: expected [^\n]*numbers"):
        Camera(*_PINHOLE, distortion)
