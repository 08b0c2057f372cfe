"""Chunks are copied as NumPy would copy them, also from memory that cannot be written."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.device.chunk_copies import CHUNK, gather_chunks, scatter_chunks

_CHUNKS = 40


@given(picks=st.sets(st.integers(0, _CHUNKS - 1)), seed=st.integers(0, 9))
def test_chunks_go_out_and_come_back(picks, seed):
    chunks = np.array(sorted(picks), np.int64)
    source = np.random.default_rng(seed).random(_CHUNKS * CHUNK, np.float32)
    source.flags.writeable = False
    rows = np.full((len(chunks), CHUNK), np.nan, np.float32)
    gather_chunks(source, chunks, rows)
    np.testing.assert_array_equal(rows, source.reshape(-1, CHUNK)[chunks])
    target, expected = np.zeros((2, _CHUNKS, CHUNK), np.float32)
    scatter_chunks(rows, chunks, target.reshape(-1))
    expected[chunks] = rows
    np.testing.assert_array_equal(target, expected)
