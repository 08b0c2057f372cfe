"""Which memory a run leaves for a rescue, and as what it is marked."""

import os
from collections.abc import Mapping, Sequence

import pytest

from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.arena.unsaved_marker import read_unsaved
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.run.run_info import RunInfo
from hsslam_services.supervisor.supervisor import Supervisor


@pytest.mark.parametrize(
    ("not_saved", "given_up", "kept"),
    [
        ({}, (), None),
        ({}, ("map", "mesh"), None),  # the user did not want to wait for them
        ({"log": "the disk was full"}, (), None),  # it is not in memory
        ({"map": "the disk was full"}, (), ("map",)),
        ({"trajectories": "the disk was full"}, ("map",), ("trajectories", "map")),
    ],
)
def test_what_could_not_be_saved_is_kept_with_what_was_given_up(
    run_info: RunInfo,
    not_saved: Mapping[str, str],
    given_up: Sequence[str],
    kept: tuple[str, ...] | None,
):
    arena = ArenaFolder("kept", run_info.path, root=run_info.path)
    (arena.path / "pose_header.bin").write_bytes((9).to_bytes(8, "little"))
    Supervisor(run_info.options)._free(arena, run_info, not_saved, given_up, DiskWork())
    assert arena.path.exists() == (kept is not None)
    unsaved = read_unsaved(arena.path)
    assert (unsaved and unsaved.artefacts) == kept


def test_no_memory_stays_though_the_disk_hangs_at_the_end(run_info: RunInfo):
    """A pipe without a writer, which a reader cannot open, is a disk that hangs."""
    pipe, disk = run_info.path / "pipe", DiskWork(hurried_s=0.2)
    os.mkfifo(pipe)
    disk.ask(pipe.read_text)
    arena = ArenaFolder("removed", run_info.path, root=run_info.path)
    supervisor = Supervisor(run_info.options)
    supervisor._signalled(2)
    supervisor._free(arena, run_info, {}, (), disk)
    assert not arena.path.exists()
    pipe.write_text("")
    arena.let_go()
