"""The row of the speed of map queries; alone, as no other row queries a map."""

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import Session

_POINTS_PER_S = 1e6
_MODULE = "hsslam_bench.scripts.query_speed"


def query_checks() -> list[Check]:
    """One check."""
    what = (
        "room, a map of 60 frames: distance, gradient, known and certainty at points near surfaces in random "
        "order, one thread, time of the process"
    )
    bound = f"{_POINTS_PER_S:.0e} points a second"
    return [Check("query:near", what, bound, _near, by_name_only=True)]


def _near(session: Session) -> Measured:
    found = session.figures(_MODULE)
    rate = found["points_per_s"]
    return Measured(
        f"{rate / 1e6:.2f} million points a second, {found['with_gradient']:.0%} with a gradient; the first "
        f"question {1e3 * found['first_s']:.0f} ms ({found['keyframes']:.0f} keyframes)",
        rate >= _POINTS_PER_S,
        found,
        rate,
        "higher",
    )
