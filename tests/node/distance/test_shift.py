import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.distance.kernels.shift import shift

_SHAPE = (4, 5, 6)
steps_of = st.tuples(*(st.integers(-n - 1, n + 1) for n in _SHAPE))


@given(steps_of)
def test_values_move_and_zeros_follow(steps):
    before = np.arange(1, 121, dtype=np.int8).reshape(_SHAPE)
    values = before.copy()
    shift(values, np.array(steps))
    source = np.moveaxis(np.indices(_SHAPE), 0, -1) + steps
    held = ((source >= 0) & (source < _SHAPE)).all(axis=-1)
    assert (values[held] == before[tuple(source[held].T)]).all()
    assert (values[~held] == 0).all()
