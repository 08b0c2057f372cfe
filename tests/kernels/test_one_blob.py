import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.field.oneblob import oneblob
from hsslam_node.kernels.one_blob import BINS, one_blob_bins


def _scattered(t):
    """All 16 bins and their slopes from the three that the kernel gives."""
    weight, slope = np.zeros(3, np.float32), np.zeros(3, np.float32)
    middle = one_blob_bins(np.float32(t), weight, slope)
    bins, slopes = np.zeros(BINS), np.zeros(BINS)
    for k, b in enumerate(range(middle - 1, middle + 2)):
        if 0 <= b < BINS:
            bins[b], slopes[b] = weight[k], slope[k]
    return bins, slopes


@given(st.floats(0.0, 1.0, width=32))
def test_bins_and_slopes_are_the_reference(t):
    bins, slopes = _scattered(t)
    x = torch.tensor([t], dtype=torch.float64)
    np.testing.assert_allclose(bins, oneblob(x)[0].numpy(), atol=2e-6)
    jacobian = torch.autograd.functional.jacobian(lambda v: oneblob(v).sum(dim=0), x)
    np.testing.assert_allclose(slopes, np.asarray(jacobian).ravel(), atol=2e-4)
