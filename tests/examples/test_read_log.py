"""The example that reads a log with pandas: a log of several parts, and what is no log."""

from pathlib import Path

import msgspec

from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_services.log.parted_log import LogSettings, PartedLog
from tests.in_process import run_script
from tests.repository import ROOT
from tests.services.wire_samples import pose

EXAMPLE = ROOT / "examples/read_log.py"
_START_NS = 1_700_000_000_000_000_000
_SECONDS = """\
                     poses  lost  latency_ms
stamp_ns                                    
2023-11-14 22:13:22     10     5        80.0
2023-11-14 22:13:20     10     0        20.0
2023-11-14 22:13:21     10     0        20.0
"""  # noqa: W291


def test_poses_of_all_parts_are_counted_by_second(tmp_path: Path):
    for first in (0, 10, 20):  # each recorder begins a part
        log = PartedLog(tmp_path, "r", LogSettings())
        for k in range(first, first + 10):  # 10 Hz
            stamp_ns = _START_NS + 100_000_000 * k
            late_ns, status = (20_000_000, "tracked") if k < 25 else (80_000_000, "lost")
            message = msgspec.structs.replace(
                pose(k, status), stamp_ns=stamp_ns, publish_ns=stamp_ns + late_ns
            )
            log.write(topics.POSE, encode(topics.POSE, message), stamp_ns, stamp_ns, k)
        log.close()
    assert len(list(tmp_path.glob("run*.mcap"))) == 3
    done = run_script(EXAMPLE, str(tmp_path))
    told = "30 poses, 83.3% tracked, latency p50 20 ms, p99 80 ms\n"
    assert (done.returncode, done.stdout) == (0, told + _SECONDS), done.stderr


def test_what_holds_no_log_is_one_line(tmp_path: Path):
    (tmp_path / "torn").mkdir()
    (tmp_path / "torn/run.mcap").write_bytes(b"no log")
    for folder in (tmp_path / "none", tmp_path / "torn"):
        done = run_script(EXAMPLE, str(folder))
        assert done.returncode == 1
        assert done.stderr.startswith(f"error: {folder}: ") and done.stderr.count("\n") == 1
