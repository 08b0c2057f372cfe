"""What the benchmark reads off the processes of a run."""

import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from hsslam_bench.runs.run_log import LogContent, LoggedPose
from hsslam_bench.runs.usage import Sample, Usage, core_ms_per_frame, memory_at, peak_memory

_SPIN = """
import sys, time
while time.process_time() < 0.4: pass
print("spun", file=sys.stderr, flush=True)
input()
"""


def test_a_process_is_named_after_its_log_and_its_time_is_counted(tmp_path: Path):
    (tmp_path / "logs").mkdir()
    with (tmp_path / "logs" / "mapper.log").open("wb") as log:
        child = subprocess.Popen(
            [sys.executable, "-c", _SPIN], stdin=subprocess.PIPE, stdout=log, stderr=subprocess.PIPE
        )
        try:
            assert child.stderr and child.stderr.readline() == b"spun\n"
            usage = Usage(psutil.Process(), tmp_path)
            usage.poll()
            usage.poll()  # too early to look again
        finally:
            child.kill()
            child.communicate()
    (sample,) = usage.samples
    assert sample.cpu_s["mapper"] >= 0.3
    assert sample.pss_bytes["mapper"] > 1e6
    assert "supervisor" in sample.cpu_s
    assert sample.shared_bytes == 0


def test_core_time_lies_between_samples():
    samples = [
        Sample(0, {"tracker": 1.0}, {}, 0),
        Sample(2_000_000_000, {"tracker": 2.0, "mapper": 0.5}, {}, 0),
        Sample(4_000_000_000, {"tracker": 2.0, "mapper": 0.5}, {}, 0),
    ]
    window_ns = (1_000_000_000, 3_000_000_000)
    assert core_ms_per_frame(samples, window_ns, 10) == pytest.approx(
        {"tracker": 50.0, "mapper": 25.0}
    )
    assert core_ms_per_frame(samples, (2_500_000_000, 3_000_000_000), 10) == {}


def test_memory_is_that_of_one_moment():
    samples = [
        Sample(1, {}, {"a": 5, "b": 1}, 0),
        Sample(2, {}, {}, 0),
        Sample(3, {}, {"a": 1, "b": 4}, 0),
    ]
    assert peak_memory(samples) == {"a": 5, "b": 1}
    assert memory_at(samples, 2) == {"a": 5, "b": 1}
    assert memory_at(samples, 3) == {"a": 1, "b": 4}
    assert memory_at(samples, 0) == {}


def test_tracking_goes_from_the_first_pose_on_the_map_to_the_last():
    poses = [
        LoggedPose(0, 10, 1.0, "initial"),
        LoggedPose(1, 30, 1.0, "lost"),
        LoggedPose(2, 40, 1.0, "tracked"),
        LoggedPose(3, 70, 1.0, "lost"),
    ]
    log = LogContent({}, poses)
    assert log.first_ns() == 10
    assert log.first_ns("tracked") == 40
    assert log.tracking_ns == (40, 70)
    assert LogContent({}, poses[:3]).tracking_ns is None
