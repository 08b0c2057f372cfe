"""The folder of a run that left a map of the small room."""

from pathlib import Path

import pytest

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.map.checkpoint import save_checkpoint
from tests.small_room import SMALL, mapped_room


@pytest.fixture(scope="session")
def mapped_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """It holds map.safetensors alone: ten keyframes at their true poses."""
    room = mapped_room()
    folder = tmp_path_factory.mktemp("mapped_run")
    checkpoint = map_snapshot(room.store, room.parameters, SMALL)
    save_checkpoint(folder / "map.safetensors", checkpoint)
    return folder
