"""Whether refinement of poses pays: runs with bundle adjustment against runs without."""

from statistics import fmean

from hsslam_node.services.bench.accuracy import ate_m, scored
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.serve_run import ServeRun, finished
from hsslam_node.services.bench.session import Session

_FACTORS = {"apartment-kinect": 0.6, "house": 1.05, "livingroom": 1.05}
_MOST_M = {"apartment-kinect": 0.03}
_LEAST_SCORED = {"lockstep": 1.0, "realtime": 0.95}  # in real time frames may be dropped


def refinement_checks() -> list[Check]:
    """One check for each pace and sequence."""
    return [_check(pace, sequence) for pace in _LEAST_SCORED for sequence in _FACTORS]


def _check(pace: str, sequence: str) -> Check:
    factor, most_m = _FACTORS[sequence], _MOST_M.get(sequence, float("inf"))

    def measure(session: Session) -> Measured:
        runs, without = (
            [finished(session.poses(sequence, s, pace, refined=refined)) for s in session.seeds]
            for refined in (True, False)
        )
        errors_m, plain_m = [ate_m(run) for run in runs], [ate_m(run) for run in without]
        mean_m, plain_mean_m = fmean(errors_m), fmean(plain_m)
        bound_m = min(factor * plain_mean_m, most_m)
        share = min(_scored_share(run) for run in (*runs, *without))
        each, plain = (", ".join(f"{100 * e:.2f}" for e in m) for m in (errors_m, plain_m))
        return Measured(
            f"{100 * mean_m:.2f} cm (seeds: {each}); without {100 * plain_mean_m:.2f} ({plain}): "
            f"{mean_m / max(plain_mean_m, 1e-9):.2f} x; {share:.1%} scored",
            mean_m <= bound_m and share >= _LEAST_SCORED[pace],
            {"rmse_m": errors_m, "without_m": plain_m, "bound_m": bound_m, "scored": share},
            mean_m,
            "lower",
        )

    limit = f" and {100 * most_m:g} cm" if sequence in _MOST_M else ""
    return Check(
        f"refinement:{pace}:{sequence}",
        f"{sequence}, {pace}: ATE RMSE, final, mean of the seeds, with BA against without",
        f"{factor:g} x{limit}",
        measure,
    )


def _scored_share(run: ServeRun) -> float:
    n, expected = scored(run)
    return n / expected if expected else 0.0
