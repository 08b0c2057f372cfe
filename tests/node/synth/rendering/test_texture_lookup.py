import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from hsslam_node.synth.rendering.texture_lookup import look_up_of, sample
from hsslam_node.synth.textures.atlas import lay_out, pyramid

_TEXELS_PER_M = 100.0


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    """A smooth random image [40, 60, 3] uint8."""
    noise = np.random.default_rng(0).uniform(0, 255, (40, 60, 3)).astype(np.float32)
    return cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX).astype(
        np.uint8
    )


def _sampled(image: np.ndarray, s: np.ndarray, q: np.ndarray, footprint: np.ndarray) -> np.ndarray:
    """Colours [n, 3] of a face, the second one of two; each pixel covers so many texels [n]."""
    other = pyramid(np.zeros((3, 5, 3), np.uint8))
    levels, texels = lay_out(other + pyramid(image))
    n = len(s)
    out = np.empty(n, np.uint32)
    width_m = (footprint / _TEXELS_PER_M / 2).astype(np.float32)
    sample(
        texels, levels, np.array([0, len(other)], np.int32),
        np.full(2, _TEXELS_PER_M, np.float32), np.ones(n, np.int32), s.astype(np.float32),
        q.astype(np.float32), width_m, np.full(n, 2, np.float32), look_up_of(n), out,
    )  # fmt: skip
    return np.stack([out & 255, out >> 8 & 255, out >> 16], axis=1).astype(float)


def _bilinear(image: np.ndarray, s: np.ndarray, q: np.ndarray) -> np.ndarray:
    h, w = image.shape[:2]
    places = np.stack([np.clip(q * h - 0.5, 0, h - 1), np.clip(s * w - 0.5, 0, w - 1)])
    channels = image.astype(float).transpose(2, 0, 1)
    return np.stack([map_coordinates(channel, places, order=1) for channel in channels], axis=1)


def _places(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    s, q = rng.uniform(0, 1, n), rng.uniform(0, 1, n)
    s[:4], q[:4] = (0, 0, 1, 1), (0, 1, 0, 1)
    return s.astype(np.float32), q.astype(np.float32)


def test_from_near_the_finest_level_alone(image: np.ndarray):
    s, q = _places(256)
    for footprint in (0.01, 1.0):
        found = _sampled(image, s, q, np.full(256, footprint))
        assert np.abs(found - _bilinear(image, s, q)).max() <= 2  # weights of 8 bits


def test_from_afar_a_mixture_of_the_two_levels_next_to_it(image: np.ndarray):
    s, q = _places(256)
    levels = pyramid(image)
    for footprint in (1.5, 3.0, 6.0):
        fine = int(np.log2(footprint))
        share = footprint / 2**fine - 1
        wanted = (1 - share) * _bilinear(levels[fine], s, q)
        wanted += share * _bilinear(levels[fine + 1], s, q)
        assert np.abs(_sampled(image, s, q, np.full(256, footprint)) - wanted).max() <= 3


def test_from_any_distance_there_is_a_level(image: np.ndarray):
    s, q = _places(256)
    found = _sampled(image, s, q, np.geomspace(1, 1e6, 256))
    assert np.abs(found[-1] - image.reshape(-1, 3).mean(0)).max() < 8
