"""The reason in the row of a log that failed."""

import dataclasses
from pathlib import Path

import pytest

from hsslam_batch.attempt.judgement import (
    judged,
    judged_frames,
    judged_with_kills,
    last_words,
)
from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.attempt.watched_process import End, Limits
from hsslam_node.errors import GPU_IS_FULL, MORE_SHARED_MEMORY
from hsslam_services.launch.spawn import how_it_ended
from hsslam_services.run.camera_progress import UNREAD

_NO_ROOM = "map not saved: /fleet/out/map.safetensors: No space left on device"


def test_what_is_not_saved_is_told_without_the_memory_that_the_batch_frees(tmp_path: Path):
    output = tmp_path / "output.txt"
    output.write_text(
        f"frame 3/6  tracked\n{_NO_ROOM}\nsummary: 6 frames\n"
        "map not saved, kept in memory: hsslam-serve rescue /dev/shm/hsslam-0-1\nframe 6/6  tracked\n"
    )
    assert last_words(output) == _NO_ROOM
    end = End(code=4, why="", wall_s=1.0, core_s=1.0, memory_mb=100)
    kind, reason = judged(end, Limits(), last_words(output))
    assert kind == "crash" and reason.endswith(_NO_ROOM)


@pytest.mark.parametrize(
    ("frames", "expected", "kind"),
    [
        ({"in": 20, "tracked": 18, "lost": 2}, 20, "done"),
        ({"in": 19, "bad": 1, "tracked": 19}, 20, "done"),
        ({"in": 19, "tracked": 19}, 20, "crash"),
        ({"in": 20, "tracked": 19}, 20, "crash"),
        ({"in": 20, "tracked": 18, "lost": 2}, None, "done"),  # of a source without a length
        ({"in": 19, "bad": 1, "tracked": 19}, None, "done"),
        ({"in": 20, "tracked": 19}, None, "crash"),
        ({}, None, "crash"),
    ],
)
def test_each_frame_needs_a_pose(frames: dict[str, int], expected: int | None, kind: Kind):
    assert judged_frames({"frames": frames}, expected)[0] == kind


@pytest.mark.parametrize(
    ("section", "reason"),
    [
        ({"log": {"frames_dropped": 0}, "processes": {"recorder": {"restarts": 1}}}, ""),
        ({"log": {"frames_dropped": 3}}, "3 frames are not in run.mcap"),
        ({"processes": {"tracker": {"restarts": 2}}}, "tracker was restarted 2 x"),
        ({"processes": {"camera": {"counters": {UNREAD: 3}}}}, "3 frames could not be read"),
    ],
)
def test_results_that_are_others_than_of_a_quiet_run_do_not_count(section: dict, reason: str):
    frames = {"in": 20, "tracked": 20}
    kind, told = judged_frames({"frames": frames, **section}, 20)
    assert (kind == "crash") == bool(reason) and told.startswith(reason)


def test_a_process_that_the_kernel_kills_is_lack_of_memory(tmp_path: Path):
    (output := tmp_path / "output.txt").write_text("frame 3")
    killed = End(code=-9, why="", wall_s=1.0, core_s=1.0, memory_mb=100, oom_kills=1)
    kind, reason = judged_with_kills(*judged(killed, Limits(), "frame 3"), killed, output)
    assert kind == "out of memory"
    said = "killed by SIGKILL; frame 3; the kernel killed a process: expected more --memory"
    assert reason == said
    quiet = dataclasses.replace(killed, oom_kills=0)
    assert judged_with_kills("crash", "a reason", quiet, output) == ("crash", "a reason")
    assert judged_with_kills("bad input", "no log", killed, output) == ("bad input", "no log")


def test_processes_that_the_kernel_kills_elsewhere_are_not_those_of_a_crash(tmp_path: Path):
    """Such as of another run on the machine; the output of the run tells which of its own were killed."""
    output = tmp_path / "output.txt"
    end = End(code=3, why="", wall_s=1.0, core_s=1.0, memory_mb=100, oom_kills=1)
    for how, kind in ((-11, "crash"), (-9, "out of memory")):
        output.write_text(
            f"frame 3/6\nwarning: tracker {how_it_ended(how)}: restart in 1 s\nframe 6/6\n"
        )
        assert judged_with_kills("crash", "a reason", end, output)[0] == kind


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        (f"/dev/shm/hsslam-1: No space left on device: {MORE_SHARED_MEMORY}", "crash"),
        (f"{GPU_IS_FULL}: expected 20.00 MiB more free, or --device cpu", "crash"),
        ("zenoh: can't start new thread: expected room for 12 threads", "crash"),
        ("--out /fleet/run: No space left on device: expected a folder with room", "crash"),
        ("out of memory: Unable to allocate 9.00 GiB for an array", "crash"),
        ("ulimit -n: this process may open 64 files: expected 128 or more", "crash"),
        ("/logs/walk/run.mcap: Input/output error: expected a log such as run.mcap", "crash"),
        ("/logs/desk/rgb.txt: Stale file handle: expected lines 'timestamp file'", "crash"),
        ("bag: no topic", "bad input"),
    ],
)
def test_a_machine_that_is_full_or_fails_is_not_the_fault_of_the_log(words: str, kind: Kind):
    end = End(code=2, why="", wall_s=1.0, core_s=1.0, memory_mb=100)
    assert judged(end, Limits(), words)[0] == kind


def test_the_last_line_is_the_reason_without_status_lines(tmp_path: Path):
    output = tmp_path / "output.txt"
    output.write_text("starting\nerror: bag: no topic\nframe 0/6\n\n")
    assert last_words(output) == "bag: no topic"
    output.write_text("frame 0/6\n")
    assert last_words(output) == "no message"
