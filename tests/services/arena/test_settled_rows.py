"""Rows of old retired keyframes take a sixth of the shared memory, so that a run may last for days."""

from pathlib import Path

import numpy as np

from hsslam_node.map.keyframes.row_slabs import BLOCK_ROWS, SLAB_ROWS
from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.shared_pages import held_bytes
from hsslam_services.run.run_info import RunInfo
from tests.long_store import STAYS, LongStore

_SETTLED_BYTES = 120  # of a row
_LATER = SLAB_ROWS


def _row_bytes(folder: Path) -> int:
    """Memory of the rows of keyframes, and not of their pixels."""
    kinds = ("meta", "poses", "covariances", "mapped", "settled")
    files = (file for kind in kinds for file in folder.glob(f"keyframe_{kind}.*.bin"))
    return held_bytes(file.stat() for file in files)


def test_a_retired_keyframe_takes_120_bytes_in_the_end(run_info: RunInfo):
    folder = Path(run_info.arena_dir)
    arena = Arena(folder)
    long = LongStore(arena)
    long.extend(3 * SLAB_ROWS)
    before = _row_bytes(folder)
    long.extend(3 * SLAB_ROWS + _LATER)
    grown = _row_bytes(folder) - before
    live = _LATER // STAYS + 1  # blocks with a keyframe that stays
    assert grown <= _LATER * _SETTLED_BYTES + live * BLOCK_ROWS * 700
    for store in (long.store, KeyframeStore(arena)):  # reading takes no memory back
        np.testing.assert_allclose(store.poses(), long.T_world_cam, atol=1e-5)
        store.poses_of(np.arange(0, store.count, 3))
        assert _row_bytes(folder) - before == grown
