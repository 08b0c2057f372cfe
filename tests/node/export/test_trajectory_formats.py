"""Trajectories in the formats of other tools: read by evo, and number by number."""

import csv
import io
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.export.trajectory_formats import TRAJECTORY_FORMATS, csv_text, kitti_text
from hsslam_node.geometry.se3_batch import exp_batch
from hsslam_node.geometry.trajectory import Trajectory, read_tum


@pytest.fixture
def trajectory() -> Trajectory:
    """Twenty poses that turn about all axes, at odd nanoseconds of today."""
    rng = np.random.default_rng(0)
    stamps_ns = 1_700_000_000_123_456_789 + np.arange(20) * 33_333_333
    return Trajectory(stamps_ns, exp_batch(rng.normal(size=(20, 6))))


def _as_tum_by_evo(kind: str, path: Path) -> Trajectory:
    """The poses that `evo_traj` reads from the file."""
    script = next(e for e in entry_points(group="console_scripts") if e.name == "evo_traj")
    run = f"import sys; from {script.module} import {script.attr} as main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", run, kind, str(path), "--save_as_tum"],
        capture_output=True,
        text=True,
        cwd=path.parent,
        env={"HOME": str(path.parent), "PATH": "", "MPLBACKEND": "Agg"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    (saved,) = path.parent.glob("*.tum")
    return read_tum(saved)


def test_evo_reads_euroc(trajectory, tmp_path):
    ending, text = TRAJECTORY_FORMATS["euroc"]
    path = tmp_path / f"poses{ending}"
    path.write_text(text(trajectory))
    first = path.read_text().splitlines()[1]
    assert first.startswith("1700000000123456789,")
    found = _as_tum_by_evo("euroc", path)
    np.testing.assert_allclose(found.T_world_cam, trajectory.T_world_cam, atol=1e-6)
    assert np.abs(found.stamps_ns - trajectory.stamps_ns).max() < 1000  # evo has float64 seconds


def test_evo_reads_kitti(trajectory, tmp_path):
    ending, text = TRAJECTORY_FORMATS["kitti"]
    path = tmp_path / f"poses{ending}"
    path.write_text(text(trajectory))
    script = next(e for e in entry_points(group="console_scripts") if e.name == "evo_traj")
    run = f"import sys; from {script.module} import {script.attr} as main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", run, "kitti", str(path)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={"HOME": str(tmp_path), "PATH": "", "MPLBACKEND": "Agg"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    length_m = np.linalg.norm(np.diff(trajectory.positions, axis=0), axis=1).sum()
    assert f"20 poses, {length_m:.3f}m path length" in done.stdout


def test_kitti_has_the_upper_rows_of_the_matrix(trajectory):
    rows = np.loadtxt(io.StringIO(kitti_text(trajectory)))
    np.testing.assert_allclose(
        rows.reshape(-1, 3, 4), trajectory.T_world_cam[:, :3], rtol=0, atol=1e-9
    )


def test_csv_names_its_columns_and_keeps_every_nanosecond(trajectory):
    rows = list(csv.DictReader(io.StringIO(csv_text(trajectory))))
    assert rows[1]["timestamp_s"] == "1700000000.156790122"
    positions = [[float(row[name]) for name in ("tx_m", "ty_m", "tz_m")] for row in rows]
    np.testing.assert_allclose(positions, trajectory.positions, rtol=0, atol=1e-9)
    norms = [sum(float(row[q]) ** 2 for q in ("qx", "qy", "qz", "qw")) for row in rows]
    np.testing.assert_allclose(norms, 1, atol=1e-8)


@pytest.mark.parametrize("kind", TRAJECTORY_FORMATS)
def test_a_trajectory_may_be_empty(kind):
    _, text = TRAJECTORY_FORMATS[kind]
    nothing = Trajectory(np.zeros(0, np.int64), np.zeros((0, 4, 4)))
    assert len(text(nothing).splitlines()) <= 1
