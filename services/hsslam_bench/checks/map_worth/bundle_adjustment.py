"""What each kind of bundle adjustment makes of the poses: rows measured only by name."""

import math
from typing import get_args

from hsslam_bench.checks.accuracy import Accuracy
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.checks.faithful import GAP_FRAMES, frames_apart, mean_of_seeds
from hsslam_bench.runs.serve_run import finished
from hsslam_bench.runs.session import Refinement, Session

_SEQUENCES = ("house-kinect", "apartment-kinect", "corridor-kinect", "kitchen")
_WITHOUT_TRUTH = (
    "kitchen"  # its given poses are good to centimetres; agreement of frames stands beside
)


def bundle_adjustment_checks() -> list[Check]:
    """One check for each sequence."""
    return [_check(sequence) for sequence in _SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        runs = {
            how: [finished(session.poses(sequence, seed, refinement=how)) for seed in session.seeds]
            for how in get_args(Refinement)
        }
        found = {how: Accuracy.of(its) for how, its in runs.items()}
        values = {how: its.values(math.inf) for how, its in found.items()}
        texts = []
        for how, its in found.items():
            text = f"{how} {100 * its.mean_m:.3f} cm ({its.each_cm(3)}), {its.lost} lost"
            if sequence == _WITHOUT_TRUTH:
                scores = [session.scores(run, "consistency") for run in runs[how]]
                rows = values[how]["consistency"] = frames_apart(scores, "estimated")
                depth_m = mean_of_seeds(how, [row["depth_median_m"] for row in rows])
                text += f", depth {1e3 * depth_m:.2f} mm, {sum(row['pairs'] for row in rows)} pairs"
            texts.append(text)
        ratio = found["graph"].mean_m / found["joint"].mean_m
        return Measured("; ".join(texts), None, values, ratio, "lower")

    depth = f"; median depth difference of frames {GAP_FRAMES} apart"
    what = (
        f"{sequence}, lockstep: ATE RMSE, final, mean of the seeds, by bundle adjustment: a pose graph "
        "(graph), none (unrefined), rendering losses of poses and map (joint), the same with random "
        "keyframes in the place of those with the largest losses (uniform); equal rays and iterations"
        f"{depth if sequence == _WITHOUT_TRUTH else ''}"
    )
    return Check(f"ba:{sequence}", what, "", measure, by_name_only=True, is_lockstep=True)
