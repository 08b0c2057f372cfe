"""The running runs of this machine, by run folder or arena."""

from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.run.find_run import running_runs
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo


def test_only_a_run_whose_supervisor_lives_is_found(tmp_path):
    shm, out = tmp_path / "shm", tmp_path / "out"
    shm.mkdir(), out.mkdir()
    arena = ArenaFolder("one", out, root=shm)
    assert running_runs(shm) == {str(arena.path): None}  # nothing said of itself yet
    run = RunInfo(
        "one", str(out), str(arena.path), "tcp/127.0.0.1:1", "robot", 1, 2, ServeOptions()
    )
    run.write()
    run.write_into_arena()
    assert running_runs(shm) == {str(out): run}
    out.rename(tmp_path / "moved")
    assert running_runs(shm) == {str(arena.path): run}
    assert RunInfo.read(arena.path) == run  # as --run does
    arena.remove()
    assert running_runs(shm) == {}
