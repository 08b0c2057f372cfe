"""Which maps a merge refuses."""

import re

import numpy as np
import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.errors import UserError
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.merging.merge_maps import merge_maps
from tests.small_room import SMALL
from tests.two_sessions import FIRST, SECOND, session


def test_maps_that_meet_in_two_ways_are_refused(tmp_path):
    """The first map has the same room twice, 20 m apart."""
    paths = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    for path, rows in zip(paths, (FIRST, SECOND), strict=True):
        store, parameters = session(rows)
        if rows is FIRST:
            aside = np.eye(4)
            aside[0, 3] = 20.0
            for k in range(store.count):
                store.append(store.frame(k), aside @ store.pose(k))
        save_checkpoint(path, map_snapshot(store, parameters, SMALL))
    with pytest.raises(UserError) as caught:
        merge_maps(MemoryAllocator(), *paths)
    told = re.fullmatch(
        rf"{paths[1]}: meets {paths[0]} in more than one way: (\d) keyframes agree on one pose, "
        r"(\d) on another: expected 3 times as many or more on one",
        str(caught.value),
    )
    assert told is not None, caught.value
    assert 8 >= int(told[1]) >= int(told[2]) > 2
