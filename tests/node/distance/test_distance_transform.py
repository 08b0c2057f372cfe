import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from hsslam_node.distance.kernels.distance_transform import (
    key_type,
    marks,
    nearest_sites,
    no_site,
    padded_width,
    site_bits,
)

shapes = st.tuples(st.integers(1, 9), st.integers(1, 20), st.integers(1, 40))


def _transform(occupied, needed, far, spare_bits=0):
    """Squared distances in voxels, and numbers of the nearest sites, [nz, ny, nx]; no site: -1."""
    count = int(occupied.sum())
    bits = site_bits(count) + spare_bits
    nz, ny, nx = occupied.shape
    keys = np.full((nz, ny, padded_width(nx)), no_site(far, bits), key_type(far, bits))
    keys[:, :, :nx][occupied] = np.arange(count)
    nearest_sites(keys, marks(needed), far, bits)
    keys = keys[:, :, :nx]
    found, keys = keys < no_site(far, bits), keys.astype(np.int64)
    return np.where(found, keys >> bits, -1), np.where(found, keys & ((1 << bits) - 1), -1)


def _reference(occupied, far):
    if not occupied.any():
        return np.full(occupied.shape, -1)
    squared = np.rint(distance_transform_edt(~occupied) ** 2).astype(int)
    return np.where(squared <= far * far, squared, -1)


@given(
    shapes,
    st.floats(0.0, 0.3),
    st.integers(1, 40),
    st.integers(0, 1000),
    st.sampled_from([0, 30]),
)
def test_distances_are_exact(shape, share, far, seed, spare_bits):
    rng = np.random.default_rng(seed)
    occupied = rng.random(shape) < share**2
    needed = rng.random(shape) < 0.5
    squared, site = _transform(occupied, needed, far, spare_bits)
    assert (squared == np.where(needed, _reference(occupied, far), -1)).all()
    places = np.argwhere(occupied)
    found = np.argwhere(squared >= 0)
    nearest = places[site[squared >= 0]] if len(found) else found
    assert (((nearest - found) ** 2).sum(axis=1) == squared[squared >= 0]).all()


@pytest.mark.parametrize("far", [3, 40])
def test_a_large_space_with_few_sites(far):
    rng = np.random.default_rng(0)
    occupied = rng.random((50, 90, 100)) < 2e-4
    squared, _ = _transform(occupied, np.ones_like(occupied), far)
    assert (squared == _reference(occupied, far)).all()


@pytest.mark.parametrize(
    ("sites", "far", "kind"),
    [
        (1 << 17, 40, np.uint32),
        (1 << 20, 40, np.uint32),
        (1 << 21, 40, np.uint64),
        (1 << 15, 200, np.uint32),
        (1 << 16, 200, np.uint64),
    ],
)
def test_keys_are_long_only_where_short_ones_are_too_short(sites, far, kind):
    assert key_type(far, site_bits(sites)) is kind
