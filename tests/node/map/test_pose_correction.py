"""What a correction carries along: retired keyframes, at the cost of those that move."""

import tracemalloc

import numpy as np

from hsslam_node.geometry.se3_batch import exp_batch, inverse_batch
from hsslam_node.map.pose_correction import carry_retired


def test_retired_keyframes_of_a_long_run_that_stay_cost_nothing():
    rng = np.random.default_rng(0)
    before = exp_batch(rng.normal(size=(40_000, 6)))
    root = np.arange(0, 40_000, 100).repeat(
        100
    )  # every hundredth is kept, the next 99 move with it
    root[-50:] = -1  # these have no anchor
    moved = np.array([700, 900, 39_900])
    after = before.copy()
    after[moved] = before[moved] @ exp_batch(rng.normal(size=(3, 6)))
    expected = after.copy()
    for k in moved.tolist():
        mine = np.flatnonzero(root == k)
        T = after[k] @ inverse_batch(before[[k]])[0]
        expected[mine[1:]] = T @ before[mine[1:]]
    tracemalloc.start()
    carry_retired(before, after, root)
    peak_bytes = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_allclose(after, expected, atol=1e-12)
    assert peak_bytes < 2e6  # all poses of the run are 5 MB
