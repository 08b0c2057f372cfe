"""What the end of a run calls missing."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.map.store import KeyframeStore
from hsslam_proto import topics
from hsslam_proto.run_messages import Health, SourceEnd
from hsslam_services.arena.arena import Arena
from hsslam_services.artefacts.fragment_names import FRAGMENTS_NOT_SAVED
from hsslam_services.artefacts.lost_results import LOG_FAILURES, POSES_NOT_LOGGED
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import (
    FINAL_MAP_SAVER,
    MESH_SAVER,
    PROCESSES,
    TRAJECTORY_SAVER,
    ProcessSpec,
)
from hsslam_services.launch.spawn import Process, spawn
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import update_summary
from hsslam_services.supervisor import orderly_end
from hsslam_services.supervisor.orderly_end import OrderlyEnd
from tests.node.sources.files.two_cameras import COLOR
from tests.until import until

_SAMPLE = "tests.services.sample_worker"


def process_row(name: str) -> ProcessSpec:
    return next(spec for spec in PROCESSES if spec.name == name)


@contextmanager
def _turn_of(run_info: RunInfo, child: Child) -> Iterator[Callable[[], None]]:
    """One turn of the supervisor's loop for one process: its heartbeats, then its state."""
    with Bus(run_info.endpoint, run_info.robot, "supervisor") as bus:
        heartbeats = bus.subscribe(topics.HEALTH, 16)

        def turn() -> None:
            for health in heartbeats.drain():
                child.heard(health)
            child.tick()
            time.sleep(0.02)

        yield turn


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


def _end(
    run_info: RunInfo,
    run_alone: Callable[[str, Callable[[], bool]], str] = lambda *_: "",
    turn: Callable[[], None] = lambda: None,
    lines: list[str] | None = None,
    **children: Child,
) -> OrderlyEnd:
    """An end whose processes never ran, but for `children`."""
    by_name = {spec.name: Child(spec, run_info.path) for spec in PROCESSES} | children
    report = ([] if lines is None else lines).append
    return OrderlyEnd(run_info, by_name, RunState(), turn, run_alone, lambda: 1, report)


@pytest.mark.parametrize("moves_at", ["", TRAJECTORY_SAVER, FINAL_MAP_SAVER])
def test_a_correction_while_results_are_saved_saves_the_trajectories_again(run_info, moves_at):
    """The saver of trajectories has copied the poses by then. Without a correction it runs once."""
    store = KeyframeStore.create(Arena(Path(run_info.arena_dir)), COLOR, 1000.0, 8)
    blank = np.zeros((COLOR.height_px, COLOR.width_px), np.uint16)
    store.append(
        Frame(0, 1, COLOR, np.dstack([blank.astype(np.uint8)] * 3), blank, 1000.0), np.eye(4)
    )
    begun: list[str] = []

    def run_alone(module: str, _: Callable[[], bool]) -> str:
        begun.append(module)
        if module == moves_at and begun.count(module) == 1:
            store.correct_poses(np.array([0]), np.eye(4)[None])
        return ""

    _end(run_info, run_alone).to_the_end()
    assert begun.count(TRAJECTORY_SAVER) == (2 if moves_at else 1)


def test_fragments_of_earlier_map_epochs_are_missing_too(run_info):
    """A reset has put its fragments and the reasons of its tracker into the summary."""
    begun = {"1": {"joined": False}, "2": {"joined": False, "map": "map_fragment_2.safetensors"}}
    update_summary(run_info.path, {"fragments": begun, FRAGMENTS_NOT_SAVED: {"1": "no room"}})
    here = ProcessResult(summary={"fragments": {"3": {"joined": True}}})
    write_result(run_info.path, "trajectory_saver", here)
    end = _end(run_info)
    end.to_the_end()
    assert end.not_saved == {"fragments": "fragment 1: no room: lost"}


@pytest.mark.parametrize(
    ("first_delay_s", "starts", "told"),
    [(0.3, 2, []), (60.0, 1, ["mapper is not running again yet: its last work may be missing"])],
)
def test_a_process_that_crashed_just_before_the_end_works_on(
    run_info, first_delay_s, starts, told, monkeypatch
):
    monkeypatch.setattr(orderly_end, "_LONGEST_RESTART_S", 30.0 if starts == 2 else 0.5)
    (run_info.path / "behaviour").write_text("obedient")
    spec = replace(process_row("mapper"), module=_SAMPLE, first_delay_s=first_delay_s)
    started: list[Process] = []

    def start(module: str, run_dir: Path) -> Process:
        started.append(spawn(module, run_dir))
        return started[-1]

    mapper, lines = Child(spec, run_info.path, start), []
    mapper.wanted = True
    with _turn_of(run_info, mapper) as turn:
        until(lambda: turn() or mapper.state == "running", 30)
        started[0].kill()
        until(lambda: turn() or mapper.state == "waiting", 30)
        _end(run_info, turn=turn, lines=lines, mapper=mapper).to_the_end()
    assert len(started) == starts and not mapper.is_alive
    assert lines == told


def test_poses_that_are_not_logged_are_missing(run_info):
    tracker = Child(process_row("tracker"), run_info.path)
    last = {"process": "tracker", "pid": tracker.pid, "state": "stopping", "rss_bytes": 0}
    tracker.heard(Health(**last, counters={POSES_NOT_LOGGED: 7}))
    end = _end(run_info, tracker=tracker)
    end.to_the_end()
    assert end.not_saved["poses"].startswith("7 are missing in the trajectories")


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


def test_a_second_signal_ends_the_wait_for_a_disk_that_hangs(run_info):
    """A pipe without a writer, which a reader cannot open, is a disk that hangs."""
    pipe, disk = run_info.path / "pipe", DiskWork(hurried_s=0.2)
    os.mkfifo(pipe)
    disk.ask(pipe.read_text)
    end = _end(run_info)
    end.disk, end.signals = disk, lambda: 2
    begun_s = time.monotonic()
    end.to_the_end()
    assert time.monotonic() - begun_s < 10
    assert end.not_saved["poses"].startswith(f"{run_info.path}: the disk does not answer for")
    pipe.write_text("")


@pytest.mark.parametrize("stuck", ["camera", "tracker"])
def test_a_process_that_hangs_does_not_delay_trajectories_and_map(run_info, stuck):
    """`docker stop` grants 10 s. A tracker may save a fragment, so it is not killed before they are saved."""
    (run_info.path / "behaviour").write_text("stuck")
    spec = replace(process_row(stuck), module=_SAMPLE, stop_timeout_s=5.0)
    child, lines = Child(spec, run_info.path, spawn), []
    child.wanted = True
    begun_s: dict[str, list[float]] = {}
    with _turn_of(run_info, child) as turn:

        def run_alone(module: str, _: Callable[[], bool]) -> str:
            begun_s.setdefault(module, []).append(time.monotonic() - start_s)
            is_alive.setdefault(module, child.is_alive)
            return ""

        until(lambda: turn() or (child.health is not None and child.health.idle_ms > 1000), 30)
        start_s, is_alive = time.monotonic(), {}
        end = _end(run_info, run_alone, turn, lines, **{stuck: child})
        end.state = RunState(source_end=SourceEnd(frame_count=9, last_index=8))
        end.to_the_end()
    assert max(begun_s[TRAJECTORY_SAVER][0], begun_s[FINAL_MAP_SAVER][0]) < 4.5
    # what a tracker has done since may be a fragment that has joined
    assert len(begun_s[TRAJECTORY_SAVER]) == (2 if stuck == "tracker" else 1)
    assert is_alive[TRAJECTORY_SAVER] == (stuck == "tracker") and not child.is_alive
    killed = ["camera does not end within 3 s: killed"]
    assert lines == (killed if stuck == "camera" else [])


def test_what_a_killed_recorder_lost_is_missing(run_info):
    """Its successor has room again, and finishes the log."""
    recorder = Child(process_row("recorder"), run_info.path)
    last = {"process": "recorder", "pid": recorder.pid, "state": "running", "rss_bytes": 0}
    recorder.heard(Health(**last, counters={LOG_FAILURES: 7}))
    write_result(run_info.path, "recorder", ProcessResult(summary={"log": {"complete": True}}))
    end = _end(run_info, recorder=recorder)
    end.to_the_end()
    assert end.not_saved["log"].startswith(
        "the disk was full or could not be written, and some messages are lost"
    )
