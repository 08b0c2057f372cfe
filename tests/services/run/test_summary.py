"""summary.json: sections merge; rate and latency come from the pose log."""

import subprocess
from pathlib import Path

import msgspec
import numpy as np
import pytest

from hsslam_node.map.pose_log import LOST, POSE_ROW, TRACKED
from hsslam_services.health.run_state import RunState
from hsslam_services.run.summary import (
    commit_of,
    evaluation_line,
    pose_section,
    read_summary,
    update_summary,
)
from tests.services.wire_samples import pose


def test_sections_merge_key_by_key(tmp_path: Path):
    assert read_summary(tmp_path) == {}
    update_summary(tmp_path, {"frames": {"tracked": 3}, "seed": 1})
    update_summary(tmp_path, {"frames": {"in": 4}, "seed": 2})
    assert read_summary(tmp_path) == {"frames": {"tracked": 3, "in": 4}, "seed": 2}


@pytest.mark.parametrize("content", ["", "[]", '{"frames": '])
def test_a_damaged_file_is_kept_and_costs_no_section(tmp_path: Path, content: str):
    (tmp_path / "summary.json").write_text(content)
    assert read_summary(tmp_path) == {}
    update_summary(tmp_path, {"seed": 1})
    assert read_summary(tmp_path) == {"seed": 1}
    assert (tmp_path / "summary.damaged.json").read_text() == content


def test_rate_and_latency_leave_out_the_first_pose():
    rows = np.zeros(31, POSE_ROW)
    rows["status"] = TRACKED
    rows["status"][5] = LOST
    rows["stamp_ns"][1:] = 10**12 + np.arange(30) * 10**8
    rows["publish_ns"] = rows["stamp_ns"] + 20_000_000
    rows["source_stamp_ns"] = 10**9 + np.arange(31) * 33_430_000_000  # sent faster than recorded
    section = pose_section([rows])
    assert section["frames"] == {"tracked": 30, "lost": 1}
    assert abs(section["wall_fps"] - 10.0) < 1e-6
    assert abs(section["sensor_s"] - 1002.9) < 1e-6  # the first stamp is 0
    assert section["latency_ms"] == {"p50": 20.0, "p95": 20.0, "p99": 20.0}


@pytest.mark.parametrize("cut", [[], [1, 20], [10, 11, 30]])
def test_a_clock_that_is_set_is_in_no_latency_as_in_status(cut: list[int]):
    rows, hour_ns = np.zeros(400, POSE_ROW), 3600 * 10**9
    rows["stamp_ns"] = 10**18 + np.arange(400) * 33_333_333
    rows["publish_ns"] = rows["stamp_ns"] + 20_000_000 + np.arange(400) * 317 % 400 * 10**5
    rows["publish_monotonic_ns"] = np.arange(400) * 33_333_333
    latencies_ms = (rows["publish_ns"] - rows["stamp_ns"]) / 1e6
    rows["publish_ns"][[10, 11]] += hour_ns  # while frames were in flight, forwards
    rows["stamp_ns"][[20, 21]] += hour_ns  # and back
    rows["publish_ns"][-40:] -= hour_ns  # for good, of a camera on another machine
    state = RunState()
    for index, row in enumerate(rows):
        stamps_ns = {"stamp_ns": int(row["stamp_ns"]), "publish_ns": int(row["publish_ns"])}
        posed = msgspec.structs.replace(pose(index), **stamps_ns)
        state.posed(posed, 1e-9 * float(row["publish_monotonic_ns"]))
    known_ms = np.delete(latencies_ms[:-40], [0, 10, 11, 20, 21])
    found = pose_section(np.split(rows, cut))["latency_ms"]
    assert found == {f"p{q}": pytest.approx(np.percentile(known_ms, q)) for q in (50, 95, 99)}
    assert state.latency_bins.cumulative()[-1] == len(known_ms) + 1  # with the first
    assert state.latency_bins.sum_ms == pytest.approx(known_ms.sum() + latencies_ms[0])


def test_there_is_no_latency_if_no_clock_fits():
    rows = np.zeros(9, POSE_ROW)
    rows["stamp_ns"] = 10**18  # of a camera whose clock is ahead for ever
    assert "latency_ms" not in pose_section([rows])


def test_there_is_no_rate_if_the_wall_clock_was_set_back():
    rows = np.zeros(31, POSE_ROW)
    rows["publish_ns"] = 10**12 + np.arange(31) * 10**8
    rows["publish_ns"][20:] -= 10**9
    for slabs in ([rows], np.split(rows, [20]), np.split(rows, [1, 21])):
        assert "wall_fps" not in pose_section(slabs)


def test_no_pose_at_all_is_a_summary_too():
    none = {"frames": {"tracked": 0, "lost": 0}}
    assert pose_section([np.zeros(0, POSE_ROW)]) == pose_section([]) == none


def test_the_evaluation_line_has_errors_in_centimetres_and_shares_in_percent():
    ate = {"online": {"rmse_m": 0.0123}, "final": {"rmse_m": 0.001}, "keyframes": {"rmse_m": None}}
    mesh = {"accuracy_mean_m": 0.0072, "completion_ratio_5cm": 0.985}
    expected = "ATE: online 1.23 cm, final 0.10 cm"
    frames = {"tracked": 380, "lost": 0}
    assert evaluation_line({"ate": ate}, frames) == expected
    with_mesh = f"{expected}; mesh: 0.72 cm off, 98.5 % complete within 5 cm"
    assert evaluation_line({"ate": ate, "mesh": mesh}, frames) == with_mesh
    none = {"ate": {"final": {"rmse_m": None}}}
    assert evaluation_line(none, frames) == "ATE: no poses to compare"


def test_the_evaluation_line_says_how_many_frames_have_no_pose():
    found = {"ate": {"final": {"rmse_m": 0.001}}}
    line = evaluation_line(found, {"tracked": 320, "lost": 60})
    assert line == "ATE of the 320 tracked frames (60 lost): final 0.10 cm"


def test_the_commit_is_that_of_a_repository_that_keeps_the_file(tmp_path: Path):
    def git(*words: str) -> str:
        command = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b", *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()

    kept, installed = tmp_path / "kept.py", tmp_path / ".venv" / "installed.py"
    installed.parent.mkdir()
    kept.touch(), installed.touch()
    assert commit_of(kept) == ""
    git("init")
    git("add", "kept.py")
    git("commit", "-m", "one")
    assert commit_of(kept) == git("rev-parse", "--short=12", "HEAD")
    assert commit_of(installed) == ""
    kept.write_text("changed")
    assert commit_of(kept).endswith("+")
