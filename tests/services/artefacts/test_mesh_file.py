"""The mesh at the end of a run."""

from dataclasses import replace

import pytest

from hsslam_node.device.device import CPU
from hsslam_node.meshing import block_grid
from hsslam_services.artefacts.mesh_file import mesh_of_arena
from tests.small_room import SMALL, mapped_room


def test_cells_that_are_too_small_for_the_map_become_larger(monkeypatch: pytest.MonkeyPatch):
    """Else the mesh could not be saved, and no rescue could save it."""
    monkeypatch.setattr(block_grid, "_MOST_CELLS", 100_000)
    room = mapped_room()
    bound = room.parameters.layout.bound
    config = replace(SMALL, mesher=replace(SMALL.mesher, final_voxel_m=0.001))
    told: list[str] = []
    mesh = mesh_of_arena(room.store, room.parameters, config, CPU, told.append)
    assert len(mesh.faces) > 100
    least_m = block_grid.least_voxel_m(bound)
    assert told[0] == (
        f"--slam.mesher.final-voxel-m 0.001: this map is too large: {least_m:.2g} m is used"
    )
