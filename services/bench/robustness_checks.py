"""What makes tracking hard: somebody in the way, changing exposure, bare walls."""

from statistics import fmean

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.lockstep_checks import ate_m, scored
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
        errors_m = [ate_m(run) for run in runs]
        counts = [scored(run) for run in runs]
        lost = sum(run.summary["frames"].get("lost", 0) for run in runs)
        complete = all(n == expected and expected > 0 for n, expected in counts)
        each = ", ".join(f"{100 * e:.2f}" for e in errors_m)
        return Measured(
            f"{100 * fmean(errors_m):.2f} cm (seeds: {each}), {lost} lost",
            fmean(errors_m) <= _BOUND_M and complete and lost == 0,
            {"rmse_m": errors_m, "scored": counts, "lost": lost, "bound_m": _BOUND_M},
            fmean(errors_m),
            "lower",
        )

    what = f"{sequence}, lockstep: ATE RMSE, final, mean of the seeds; all scored, none lost"
    return Check(f"robust:{sequence}", what, f"{100 * _BOUND_M:g} cm", measure)
