"""What the end of a run calls missing."""

from collections.abc import Callable

from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import FINAL_MAP_SAVER, MESH_SAVER, PROCESSES
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.supervisor.orderly_end import OrderlyEnd


def test_what_was_not_saved_is_missing_though_a_second_signal_cuts_the_next_try_short(run_info):
    """The map is saved twice. The mesh, which the user does not wait for, is not missing."""
    begun: list[str] = []

    def run_alone(module: str, is_cancelled: Callable[[], bool]) -> str:
        begun.append(module)
        return "cancelled" if is_cancelled() else "the disk is full"

    def signals() -> int:
        return 2 if begun.count(FINAL_MAP_SAVER) == 2 else 1

    lines: list[str] = []
    children = {spec.name: Child(spec, run_info.path) for spec in PROCESSES}
    end = OrderlyEnd(
        run_info, children, RunState(tracked=9), lambda: None, run_alone, signals, lines.append
    )
    end.to_the_end()
    assert list(end.not_saved) == ["trajectories", "map"]
    assert lines[-2:] == [
        "map not saved: the disk is full",
        "mesh not saved: a second signal ended the run",
    ]
    assert end.given_up == ["mesh"]
    assert MESH_SAVER not in begun


def test_a_fragment_that_the_tracker_could_not_save_is_missing(run_info):
    begun = {
        "1": {"joined": True},
        "2": {"joined": False},
        "3": {"joined": False},
        "4": {"joined": False, "map": "map_fragment_4.safetensors"},
    }
    write_result(run_info.path, "trajectory_saver", ProcessResult(summary={"fragments": begun}))
    failed = ProcessResult(summary={FRAGMENTS_NOT_SAVED: {2: "the disk is full"}})
    write_result(run_info.path, "tracker", failed)
    children = {spec.name: Child(spec, run_info.path) for spec in PROCESSES}
    end = OrderlyEnd(
        run_info, children, RunState(), lambda: None, lambda *_: "", lambda: 1, lambda _: None
    )
    end.to_the_end()
    why = "fragment 2: the disk is full; fragment 3: its tracker ended before: lost"
    assert end.not_saved == {"fragments": why}
