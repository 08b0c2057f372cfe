"""ATE and RPE are those of evo, which runs as a command beside us (GPL: it is never imported)."""

import importlib.util
import json
import subprocess
import sys
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.evaluation.trajectory.rpe import rpe_per_frame, rpe_per_second
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory, read_tum, write_tum
from tests.node.evaluation.trajectory.trajectories import shaken, walk

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("evo") is None, reason="evo is not installed"
)
_TOLERANCE = 1e-6  # m, degrees


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> tuple[Path, Path]:
    """A truth, and an estimate in another world with lost frames and stamps that are a little off."""
    folder = tmp_path_factory.mktemp("evo")
    truth = walk(150)
    estimate = shaken(truth)
    kept = np.setdiff1d(np.arange(150), [3, 40, 41, 42, 99])
    rng = np.random.default_rng(2)
    stamps_ns = estimate.stamps_ns[kept] + rng.integers(-5_000_000, 5_000_000, len(kept))
    T = se3_exp(np.array([1.0, -2.0, 0.5, 0.3, 2.0, -1.0]))
    write_tum(folder / "truth.txt", truth)
    write_tum(folder / "estimate.txt", Trajectory(stamps_ns, T @ estimate.T_world_cam[kept]))
    return folder / "truth.txt", folder / "estimate.txt"


def _evo(tool: str, files: tuple[Path, Path], *options: str) -> dict[str, float]:
    """Statistics that `evo_ape` or `evo_rpe` saves, at full precision."""
    saved = files[0].parent / f"{tool}{len(options)}.zip"
    saved.unlink(missing_ok=True)
    script = next(e for e in entry_points(group="console_scripts") if e.name == f"evo_{tool}")
    run = f"import sys; from {script.module} import {script.attr} as main; sys.exit(main())"
    command = [sys.executable, "-c", run, "tum", *map(str, files), "--t_max_diff", "0.02"]
    done = subprocess.run(
        [*command, *options, "--save_results", str(saved), "--silent"],
        capture_output=True,
        text=True,
        env={"HOME": str(files[0].parent), "PATH": "", "MPLBACKEND": "Agg"},
    )
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(saved) as archive:
        return json.loads(archive.read("stats.json"))


def test_ate_is_that_of_evo(files):
    found = ate(read_tum(files[1]), read_tum(files[0]))
    theirs = _evo("ape", files, "--align")
    assert found.scored == 145
    assert found.rmse_m == pytest.approx(theirs["rmse"], abs=_TOLERANCE)
    assert found.mean_m == pytest.approx(theirs["mean"], abs=_TOLERANCE)
    assert found.max_m == pytest.approx(theirs["max"], abs=_TOLERANCE)


def test_translation_per_frame_is_that_of_evo(files):
    found = rpe_per_frame(read_tum(files[1]), read_tum(files[0]))
    theirs = _evo("rpe", files, "-r", "trans_part", "-d", "1", "-u", "f")
    assert found.translation_rmse_m == pytest.approx(theirs["rmse"], abs=_TOLERANCE)
    assert found.translation_mean_m == pytest.approx(theirs["mean"], abs=_TOLERANCE)
    assert found.translation_max_m == pytest.approx(theirs["max"], abs=_TOLERANCE)


def test_rotation_per_second_is_that_of_evo(tmp_path):
    """Over trajectories without gaps, where a second is thirty frames."""
    truth = walk(120)
    files = tmp_path / "truth.txt", tmp_path / "estimate.txt"
    for path, trajectory in zip(files, (truth, shaken(truth)), strict=True):
        write_tum(path, trajectory)
    found = rpe_per_second(read_tum(files[1]), read_tum(files[0]))
    theirs = _evo("rpe", files, "-r", "angle_deg", "-d", "30", "-u", "f", "--all_pairs")
    assert found.rotation_rmse_deg == pytest.approx(theirs["rmse"], abs=_TOLERANCE)
    assert found.rotation_mean_deg == pytest.approx(theirs["mean"], abs=_TOLERANCE)
    assert found.rotation_max_deg == pytest.approx(theirs["max"], abs=_TOLERANCE)
