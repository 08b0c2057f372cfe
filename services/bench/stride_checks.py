"""Fewer frames a second: only every second and every third frame."""

from statistics import fmean

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.lockstep_checks import ate_m, scored
from hsslam_node.services.bench.serve_run import finished
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("livingroom", "kitchen")
_STRIDES = {2: "second", 3: "third"}
_FACTOR = 2.0  # of the ATE at full rate


def stride_checks() -> list[Check]:
    """One check for each sequence and stride."""
    return [_check(sequence, stride) for sequence in _SEQUENCES for stride in _STRIDES]


def _check(sequence: str, stride: int) -> Check:
    def measure(session: Session) -> Measured:
        full = [ate_m(finished(session.poses(sequence, seed))) for seed in session.seeds]
        runs = [finished(session.poses(sequence, s, stride=stride)) for s in session.seeds]
        errors_m = [ate_m(run) for run in runs]
        counts = [scored(run) for run in runs]
        lost = sum(run.summary["frames"].get("lost", 0) for run in runs)
        complete = all(n == expected and expected > 0 for n, expected in counts)
        bound_m = _FACTOR * fmean(full)
        each = ", ".join(f"{100 * e:.2f}" for e in errors_m)
        return Measured(
            f"{100 * fmean(errors_m):.2f} cm (seeds: {each}), {lost} lost; "
            f"full rate {100 * fmean(full):.2f} cm",
            fmean(errors_m) <= bound_m and complete and lost == 0,
            {"rmse_m": errors_m, "scored": counts, "lost": lost, "bound_m": bound_m},
            fmean(errors_m),
            "lower",
        )

    what = (
        f"every {_STRIDES[stride]} frame of {sequence}, lockstep: ATE RMSE, final, mean of the "
        "seeds; all scored, none lost"
    )
    return Check(f"stride:{sequence}:{stride}", what, f"{_FACTOR:g} x full rate", measure)
