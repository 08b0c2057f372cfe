"""Measures how well odometry alone can place the frames of a covered lens; prints JSON.

`python -m hsslam_bench.scripts.odometry_limit` takes the true poses of the built-in room before and after
the covered frames, and the odometry of `odometry:covered:room` between them. The rest of the error is what
no estimate from the same readings can know: the ATE (RMSE) of a run whose other frames are exact.
"""

import argparse
import json

import numpy as np

from hsslam_bench.runs.session import COVER_AT, COVER_FRAMES, ODOMETRY_NOISE
from hsslam_node.odometry.simulated import simulated_odometry
from hsslam_node.odometry.spread_errors import spread_errors
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
    """ATE RMSE, cm: mean over the seeds of the row, mean and 5 % quantile over all."""
    T_true = synth_truth("room", SourceOptions())[0].T_world_cam
    is_covered = np.zeros(len(T_true), np.bool_)
    is_covered[COVER_AT : COVER_AT + COVER_FRAMES] = True
    errors_cm = []
    for seed in range(seeds):
        readings = simulated_odometry(T_true, float(ODOMETRY_NOISE), seed)
        T_odom_cam = np.stack([reading.T_odom_cam for reading in readings])
        found = spread_errors(T_true, T_odom_cam, is_covered, np.zeros_like(is_covered))
        off_m = np.linalg.norm(found[:, :3, 3] - T_true[:, :3, 3], axis=1)
        errors_cm.append(100 * np.sqrt(np.square(off_m).mean()))
    return {
        "of_row_cm": float(np.mean(errors_cm[:_OF_ROW])),
        "mean_cm": float(np.mean(errors_cm)),
        "q05_cm": float(np.quantile(errors_cm, 0.05)),
        "seeds": seeds,
    }


if __name__ == "__main__":
    main()
