import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.config import FieldConfig
from hsslam_node.field.layout import FieldLayout
from hsslam_node.field.oneblob import oneblob
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.kernel_layout import kernel_layout
from hsslam_node.kernels.one_blob import BINS, one_blob, one_blob_space

_UNIT = kernel_layout(
    FieldLayout(FieldConfig(hash_levels=0), Bound((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)))
)


def _scattered(t):
    """All 16 bins and their slopes from the three that the kernel gives, for each axis."""
    blob = one_blob_space()
    one_blob(_UNIT, np.full((1, 3), t, np.float32), blob)
    bins, slopes = np.zeros(3 * BINS), np.zeros(3 * BINS)
    for a in range(3):
        for k in range(3):
            bins[blob.first[a, 0] + k] = blob.weight[3 * a + k, 0]
            slopes[blob.first[a, 0] + k] = blob.slope[3 * a + k, 0]
    return bins, slopes


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
