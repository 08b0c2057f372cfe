"""Changing exposure: bounded, smooth but for its jumps, depth untouched."""

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.effects.changing_exposure import ChangingExposure, exposure
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import BadFrame


class _Grey:
    """Frames of one grey level, and a bad one."""

    name, rate_hz, frame_count, depth_units_per_m = "grey", 30.0, 300, 5000.0
    camera = Camera(8, 6, 6.5, 6.5, 3.5, 2.5)

    def frames(self, first=0):
        for k in range(first, 300):
            color = np.full((6, 8, 3), 128, np.uint8)
            yield Frame(k, k, self.camera, color, np.full((6, 8), 9000, np.uint16), 5000.0)
        yield BadFrame(300, 300, "torn")


def _gains(seed: int, count: int = 2000) -> np.ndarray:
    return np.array([exposure(seed, k)[0] for k in range(count)])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_gain_and_bias_are_bounded_and_really_change(seed):
    gains = _gains(seed)
    assert gains.min() > 0.62 and gains.max() < 1.55
    assert np.ptp(gains) > 0.3
    bias = np.array([exposure(seed, k)[1] for k in range(2000)])
    assert np.abs(bias).max() <= 6
    assert np.ptp(bias) > 10


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_few_jumps_of_20_to_30_percent_and_nothing_between(seed):
    change = np.abs(np.diff(np.log(_gains(seed))))
    jumps = change > np.log(1.1)
    assert 12 <= jumps.sum() <= 17  # one in 120 frames
    assert (np.abs(change[jumps] - np.log(1.26)) < 0.05).all()
    assert change[~jumps].max() < 0.01


def test_images_show_gain_and_bias_and_depth_is_untouched():
    *frames, bad = ChangingExposure(_Grey(), 3).frames()
    assert bad.reason == "torn"
    for frame in frames[::37]:
        gain, bias = exposure(3, frame.index)
        assert abs(int(frame.color[2, 3, 1]) - (128 * gain + bias)) <= 0.51
        assert (frame.color == frame.color[0, 0, 0]).all()
        assert (frame.depth_raw == 9000).all()


def test_the_seed_decides():
    np.testing.assert_array_equal(_gains(0, 200), _gains(0, 200))
    assert np.abs(_gains(0, 200) - _gains(1, 200)).max() > 0.05


def test_any_source_can_have_it():
    synth = SynthOptions(width_px=96, height_px=72)
    options = SourceOptions(frames=1, synth=synth, exposure="drift", noise="kinect", downscale=2)
    (changed,) = open_source("synth:room", options).frames()
    plain = SourceOptions(frames=1, synth=synth, noise="kinect", downscale=2)
    (same,) = open_source("synth:room", plain).frames()
    np.testing.assert_array_equal(changed.depth_raw, same.depth_raw)
    gain, bias = exposure(0, 0)
    expected = np.clip(gain * same.color.astype(float) + bias, 0, 255)
    assert np.abs(changed.color - expected).max() < 2


def test_a_wrong_value_is_told():
    with pytest.raises(UserError, match="--exposure 'wild': expected none or drift"):
        SourceOptions(exposure="wild")  # type: ignore[arg-type]
