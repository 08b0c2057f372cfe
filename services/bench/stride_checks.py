"""Fewer frames a second: only every second and every third frame."""

from hsslam_node.services.bench.accuracy import Accuracy
from hsslam_node.services.bench.check import Check, Measured
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
        full, found = (
            Accuracy.of([finished(session.poses(sequence, s, stride=n)) for s in session.seeds])
            for n in (1, stride)
        )
        bound_m = _FACTOR * full.mean_m
        return Measured(
            f"{100 * found.mean_m:.2f} cm (seeds: {found.each_cm()}), {found.lost} lost; "
            f"full rate {100 * full.mean_m:.2f} cm",
            found.mean_m <= bound_m and found.complete,
            found.values(bound_m),
            found.mean_m,
            "lower",
        )

    what = (
        f"every {_STRIDES[stride]} frame of {sequence}, lockstep: ATE RMSE, final, mean of the "
        "seeds; all scored, none lost"
    )
    return Check(f"stride:{sequence}:{stride}", what, f"{_FACTOR:g} x full rate", measure)
