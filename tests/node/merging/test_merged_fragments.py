"""A merge of two fragments, which have no field, makes a map as a run does."""

from collections.abc import Iterable
from dataclasses import replace

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.merging.merge_maps import merge_maps
from hsslam_node.progress import Item
from tests.small_room import SMALL
from tests.two_sessions import FIRST, SECOND, session


def test_the_field_gets_all_iterations_of_a_run(tmp_path):
    paths = tmp_path / "first.safetensors", tmp_path / "second.safetensors"
    for path, rows in zip(paths, (FIRST, SECOND), strict=True):
        store, parameters = session(rows)
        saved = map_snapshot(store, parameters, SMALL)
        save_checkpoint(path, replace(saved, is_fitted=False))
    iterations = []

    def track(
        sequence: Iterable[Item], total: float | None = None, *, description: str = ""
    ) -> Iterable[Item]:
        if description != "map":
            return sequence
        iterations.extend(sequence)
        return []  # all of them take seconds

    mapper = merge_maps(MemoryAllocator(), *paths, track=track).config.mapper
    each = mapper.iterations + mapper.last_iterations
    assert mapper.first_iterations > 0
    assert len(iterations) == mapper.first_iterations + 16 * each
