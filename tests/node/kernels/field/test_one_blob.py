import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.field.layout import BLOCK, kernel_layout
from hsslam_node.kernels.field.one_blob import (
    BINS,
    add_blob_gradient,
    one_blob,
    one_blob_space,
    padded_blob_rows,
)
from hsslam_node.map.layout import FieldLayout
from hsslam_node.reference.encodings import oneblob

_UNIT = kernel_layout(
    FieldLayout(FieldConfig(hash_levels=0), Bound((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
)


def _scattered(t):
    """All 16 bins and their slopes from the three that the kernel gives, for each axis."""
    blob = one_blob_space()
    one_blob(_UNIT, np.full((3, 1), t, np.float32), 0, 1, blob)
    bins, slopes = np.zeros((3, BINS + 2)), np.zeros((3, BINS + 2))  # a row more on either side
    for a in range(3):
        row = blob.first[BLOCK * a]
        for k in range(3):
            bins.flat[row + k] = blob.weight[(3 * a + k) * BLOCK]
            slopes.flat[row + k] = blob.slope[(3 * a + k) * BLOCK]
    return bins[:, 1:-1].ravel(), slopes[:, 1:-1].ravel()


def test_padded_rows_have_zeros_at_the_ends_of_each_axis():
    rows = np.random.default_rng(0).normal(size=(3 * BINS, 32)).astype(np.float32)
    padded = padded_blob_rows(rows)
    by_axis = padded.reshape(3, BINS + 2, 32)
    np.testing.assert_array_equal(by_axis[:, 1:-1].reshape(rows.shape), rows)
    assert not by_axis[:, [0, -1]].any()
    back = np.ones_like(rows)
    add_blob_gradient(padded + 1, back)
    np.testing.assert_allclose(back, rows + 2, atol=1e-6)
    assert padded_blob_rows(rows[:0]).shape == (0, 32)


@given(st.floats(-1.0, 2.0, width=32))
def test_bins_and_slopes_are_the_reference(t):
    """Beyond the box, where the map has grown, the bins are those of its border."""
    bins, slopes = _scattered(t)
    x = torch.tensor([t], dtype=torch.float64)
    border = oneblob(x.clamp(0.0, 1.0))
    np.testing.assert_allclose(bins, np.tile(border[0].numpy(), 3), atol=2e-6)
    if not 0.0 <= t <= 1.0:
        assert not slopes.any()
        return
    jacobian = torch.autograd.functional.jacobian(lambda v: oneblob(v).sum(dim=0), x)
    np.testing.assert_allclose(slopes, np.tile(np.asarray(jacobian).ravel(), 3), atol=2e-4)
