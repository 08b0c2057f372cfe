"""What makes tracking hard: somebody in the way, changing exposure, bare walls."""

from hsslam_node.services.bench.accuracy import Accuracy
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.serve_run import finished
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("person-kinect", "room-kinect-exposure", "corridor-kinect")
_BOUND_M = 0.02


def robustness_checks() -> list[Check]:
    """One check for each sequence."""
    return [_check(name) for name in _SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        runs = [finished(session.poses(sequence, seed)) for seed in session.seeds]
        found = Accuracy.of(runs)
        return Measured(
            f"{100 * found.mean_m:.2f} cm (seeds: {found.each_cm()}), {found.lost} lost",
            found.mean_m <= _BOUND_M and found.complete,
            found.values(_BOUND_M),
            found.mean_m,
            "lower",
        )

    what = f"{sequence}, lockstep: ATE RMSE, final, mean of the seeds; all scored, none lost"
    return Check(f"robust:{sequence}", what, f"{100 * _BOUND_M:g} cm", measure)
