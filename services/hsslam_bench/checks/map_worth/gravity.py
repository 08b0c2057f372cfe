"""Rows of the error of a run's up direction with an IMU."""

import numpy as np

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.sources.options.source import SourceOptions

_MOST_DEG = 0.5
_UP = np.array([0.0, 0.0, 1.0])  # in the built-in scenes


def gravity_checks() -> list[Check]:
    """One row a sequence."""
    return [_gravity_check(sequence) for sequence in ("room", "room-kinect")]


def _gravity_check(sequence: str) -> Check:
    source = f"synth:{sequence.partition('-')[0]}"

    def measure(session: Session) -> Measured:
        runs = [finished(session.with_imu(sequence, seed)) for seed in session.seeds]
        off_deg = [_off_deg(run, source) for run in runs]
        own_deg = [run.summary["up"]["sigma_deg"] if "up" in run.summary else None for run in runs]
        each = ", ".join("not known" if off is None else f"{off:.3f}" for off in off_deg)
        known = [off for off in off_deg if off is not None]
        worst_deg = max(known) if len(known) == len(runs) else 180.0
        return Measured(
            f"{each} degrees", worst_deg <= _MOST_DEG, {"off_deg": off_deg, "sigma_deg": own_deg},
            worst_deg, "lower",
        )  # fmt: skip

    depth = "Kinect noise" if sequence.endswith("-kinect") else "exact depth"
    what = (
        f"room, {depth}, lockstep, a cheap IMU (--synth.imu-noise 1): angle between up in summary.json and "
        "against gravity, each seed"
    )
    return Check(f"gravity:{sequence}", what, f"{_MOST_DEG:g} degrees", measure, is_lockstep=True)


def _off_deg(run: ServeRun, source: str) -> float | None:
    """Angle between the run's up and the true up, both in the first camera's axes; None: no up in the run."""
    truth = open_ground_truth(source, SourceOptions())
    if "up" not in run.summary or truth is None:
        return None
    first = read_tum(run.folder / "trajectory.txt").T_world_cam[0]
    up = first[:3, :3].T @ np.array(run.summary["up"]["direction"])
    cosine = float(up @ (truth.T_world_cam[0][:3, :3].T @ _UP))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
