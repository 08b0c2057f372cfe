"""Measures how well odometry alone can place the frames of a covered lens; prints JSON.

`python -m hsslam_bench.scripts.odometry_limit` takes the true poses of the built-in room before and after
the covered frames, and the odometry of `odometry:covered:room` between them. It estimates the covered poses
as the service does, and as an estimate would that knows how the simulated errors are distributed: no better
one is possible from the same readings. The result is the ATE (RMSE) of a run whose other frames are exact.
"""

import argparse
import json

import numpy as np

from hsslam_bench.runs.session import COVER_AT, COVER_FRAMES, ODOMETRY_NOISE
from hsslam_node.geometry.pose_covariance import turned
from hsslam_node.geometry.se3 import inverse, se3_log
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.odometry.spread_errors import Walk, spread_errors, usual_walk
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.synth import synth_truth

_SEEDS, _QUICK_SEEDS = 203, 5
_OF_ROW = 3  # seeds that the row runs


def main() -> None:
    parser = argparse.ArgumentParser(prog="odometry_limit", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few seeds")
    seeds = _QUICK_SEEDS if parser.parse_args().quick else _SEEDS
    print(json.dumps(odometry_limit(seeds)))


def odometry_limit(seeds: int) -> dict[str, float]:
    """ATE RMSE, cm: mean over the seeds of the row, mean and 5 % quantile over all; mean of the best."""
    T_true = synth_truth("room", SourceOptions())[0].T_world_cam
    usual_cm, best_cm = (
        np.array([_error_cm(T_true, seed, walk) for seed in range(seeds)])
        for walk in (usual_walk, _simulated_walk)
    )
    return {
        "of_row_cm": float(usual_cm[:_OF_ROW].mean()),
        "mean_cm": float(usual_cm.mean()),
        "q05_cm": float(np.quantile(usual_cm, 0.05)),
        "best_mean_cm": float(best_cm.mean()),
        "seeds": seeds,
    }


def _error_cm(T_true: np.ndarray, seed: int, walk: Walk) -> float:
    is_covered = np.zeros(len(T_true), np.bool_)
    is_covered[COVER_AT : COVER_AT + COVER_FRAMES] = True
    readings = simulated_odometry(T_true, float(ODOMETRY_NOISE), seed)
    T_odom_cam = np.stack([reading.T_odom_cam for reading in readings])
    found = spread_errors(T_true, T_odom_cam, is_covered, np.zeros_like(is_covered), walk)
    off_m = np.linalg.norm(found[:, :3, 3] - T_true[:, :3, 3], axis=1)
    return float(100 * np.sqrt(np.square(off_m).mean()))


def _simulated_walk(T_a: np.ndarray, T_b: np.ndarray) -> np.ndarray:
    """The random walk of `simulated_odometry`, where the error of scale has deviation 1, [6, 6]."""
    twist = se3_log(inverse(T_a) @ T_b)
    sizes = np.repeat([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])], 3)
    return turned(np.diag(np.square(sizes) / 3), T_b[:3, :3])


if __name__ == "__main__":
    main()
