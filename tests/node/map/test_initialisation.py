import math

import numpy as np

from hsslam_node.map.initialisation import initial_parameters


def test_same_seed_same_parameters_other_seed_others(layout):
    a, b = initial_parameters(layout, 3), initial_parameters(layout, 3)
    np.testing.assert_array_equal(a, b)
    assert a.dtype == np.float32 and a.shape == (layout.parameter_count,)
    assert (initial_parameters(layout, 4) != a).mean() > 0.9


def test_blocks_have_the_published_distributions(layout):
    params = initial_parameters(layout, 0)
    for block in layout.blocks.values():
        values = block.view(params)
        if block.name == "log_beta":
            assert math.exp(values[0]) == np.float32(10.0) or abs(math.exp(values[0]) - 10) < 1e-4
        elif block.name.startswith("hash."):
            assert np.abs(values).max() <= 1e-4 and values.std() > 4e-5
        elif "_decoder." in block.name:
            assert np.abs(values).max() <= 1 / math.sqrt(block.shape[0])
        else:
            assert 0.008 < values.std() < 0.012


def test_padding_stays_zero(layout):
    params = initial_parameters(layout, 0)
    for block in layout.blocks.values():
        block.view(params)[...] = 0
    assert not params.any()
