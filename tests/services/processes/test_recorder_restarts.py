"""A recorder that is killed, and its successor."""

import json
import signal
import subprocess
import sys
import time

import msgspec
import numpy as np
import psutil
import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.commands.log.newest_mesh import newest_mesh
from hsslam_services.log.file_index import is_finished
from tests.services.recorded import read_log, rrd_rows
from tests.services.wire_samples import blocks, frame, keyframe, pose
from tests.until import until

_LATE_BYTES = 100e6
RECORDER = """
import json, signal, sys
from pathlib import Path
from hsslam_services.bus.bus import Bus
from hsslam_services.processes.recorder import Recorder
stop = []
signal.signal(signal.SIGTERM, lambda *_: stop.append(1))
with Bus(sys.argv[1], "r", "recorder") as bus:
    recorder = Recorder(bus, Path(sys.argv[2]), "run-1", "none", lambda *e: print(*e, flush=True))
    print("ready", flush=True)
    while not stop:
        recorder.spin_once()
    print(json.dumps(recorder.close()), flush=True)
"""


@pytest.fixture
def start(endpoint, tmp_path):
    """Start a recorder of the run folder; what is left of them ends with the test."""
    started = []

    def start_one() -> subprocess.Popen:
        command = [sys.executable, "-c", RECORDER, endpoint, str(tmp_path)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        started.append(process)
        assert process.stdout is not None
        said = iter(process.stdout.readline, "")
        assert any("ready" in line for line in said), f"the recorder ended with {process.wait()}"
        return process

    yield start_one
    for process in started:
        process.kill()
        process.wait()


def test_a_killed_recorder_is_continued_in_the_next_part(endpoint, tmp_path, start):
    with Bus(endpoint, "r", "tracker") as bus:
        poses, keyframes = bus.publisher(topics.POSE), bus.publisher(topics.KEYFRAME)
        frames = bus.publisher(topics.FRAME, block=True)
        meshes = bus.publisher(topics.MESH_BLOCKS)
        meshes.answer_with(lambda: [blocks(3, 0, 1, 2)])
        first = start()
        until(frames.has_subscribers)  # what is sent before is not kept
        meshes.put(blocks(2, 0, 1))
        meshes.put(blocks(3, 2))
        for index in range(100):
            poses.put(pose(index))
            frames.put(frame(index))
            if index % 10 == 0:
                keyframes.put(keyframe(index // 10))
            time.sleep(0.02)
        first.kill()
        first.wait()
        until(lambda: not frames.has_subscribers())
        for index in range(100, 120):
            poses.put(pose(index))
            frames.put(frame(index))
        second = start()
        until(frames.has_subscribers)
        for index in range(120, 140):
            poses.put(pose(index))
            frames.put(frame(index))
            time.sleep(0.02)
        second.send_signal(signal.SIGTERM)
        assert second.wait(timeout=20) == 0, second.communicate()
    assert is_finished(tmp_path / "run.mcap")
    one, two = read_log(tmp_path / "run.mcap"), read_log(tmp_path / "run.1.mcap")
    indices = [m.index for m in one["out/pose"] + two["out/pose"]]
    assert sorted(indices) == list(range(140))  # none lost, none twice
    assert [m.id for m in one["out/keyframe"] + two.get("out/keyframe", [])] == list(range(10))
    assert two["out/mesh_blocks"]  # a part opens alone: it has all blocks
    assert rrd_rows(tmp_path / "run.1.rrd", "/plots/quality") == 1 + 140  # its style, every pose
    for part in ("run.mcap", "run.1.mcap"):
        mesh = newest_mesh([tmp_path / part])
        assert mesh is not None and len(mesh.triangles.faces) == 3 and not mesh.is_final
    summary = json.loads(second.stdout.read().splitlines()[-1])
    assert summary["poses_logged"] == 140
    assert summary["frames_dropped"] >= 20
    assert summary["frames_logged"] + summary["frames_dropped"] == 140
    assert summary["parts"] == ["run.mcap", "run.1.mcap"]


def test_poses_that_come_while_there_is_no_recorder_for_too_long_are_counted(
    endpoint, tmp_path, start
):
    """Their sender keeps the last 600."""
    with Bus(endpoint, "r", "tracker") as bus:
        poses, frames = bus.publisher(topics.POSE), bus.publisher(topics.FRAME, block=True)
        first = start()
        until(frames.has_subscribers)
        for index in range(50):
            poses.put(pose(index))
            time.sleep(0.04)  # so that its state is saved once a second
        first.kill()
        first.wait()
        for index in range(50, 800):
            poses.put(pose(index))
        second = start()
        until(frames.has_subscribers)
        poses.put(pose(800))
        second.send_signal(signal.SIGTERM)
        assert second.wait(timeout=20) == 0, second.communicate()
    assert second.stdout is not None
    summary = json.loads(second.stdout.read().splitlines()[-1])
    missing = 801 - summary["poses_logged"]
    assert 140 <= missing <= 180
    assert summary["poses_dropped"] == missing and summary["lost"] == {"out/pose": missing}
    assert not summary["complete"]


def test_a_recorder_that_is_restarted_late_goes_on_at_once(endpoint, tmp_path, start):
    """100 MB are in the log: its successor needs neither time nor memory for them, nor a second copy."""
    with Bus(endpoint, "r", "tracker") as bus:
        poses, frames = bus.publisher(topics.POSE), bus.publisher(topics.FRAME, block=True)
        began_s = time.monotonic()
        first = start()
        first_s = time.monotonic() - began_s
        noise = np.random.default_rng(0).bytes(2**22)
        small = frame(0, compressed=True)
        big = msgspec.structs.replace(small, color=memoryview(bytes(small.color) + noise))
        sent = 0
        while (tmp_path / "run.mcap").stat().st_size < _LATE_BYTES:
            assert sent < 1000, (first.poll(), (tmp_path / "run.mcap").stat().st_size)
            frames.put(msgspec.structs.replace(big, index=sent))
            poses.put(pose(sent))
            sent += 1
            time.sleep(0.03)
        first.kill()
        first.wait()
        began_s = time.monotonic()
        second = start()
        before = psutil.Process(second.pid).memory_info().rss
        poses.put(pose(sent))
        most, seconds = before, time.monotonic() - began_s
        deadline = began_s + 60
        while not is_finished(tmp_path / "run.mcap"):
            most = max(most, psutil.Process(second.pid).memory_info().rss)
            time.sleep(0.02)
            assert not (tmp_path / ".run.mcap.recovering").exists()
            if time.monotonic() > deadline:
                second.terminate()
                raise AssertionError(second.communicate())
        second.send_signal(signal.SIGTERM)
        assert second.wait(timeout=20) == 0, second.communicate()
    assert seconds < 3 * first_s + 2  # as long as the start with an empty folder
    assert most - before < 100e6
    one, two = read_log(tmp_path / "run.mcap"), read_log(tmp_path / "run.1.mcap")
    indices = [m.index for m in one["out/pose"] + two["out/pose"]]
    assert sorted(indices) == list(range(sent + 1))
    summary = json.loads(second.stdout.read().splitlines()[-1])
    assert summary["poses_logged"] == sent + 1
    assert not (tmp_path / ".run.mcap.recorded").exists()
