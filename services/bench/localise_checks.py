"""A camera in a saved map that it must not change."""

import json

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("livingroom",)


def localise_checks() -> list[Check]:
    """One row a sequence."""
    return [_check(sequence) for sequence in _SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        source = session.source(sequence)
        module = f"{__package__}.localise_run"
        scores = [json.loads(session.python(module, source, str(s))) for s in session.seeds]
        worst_m = max(score["max_m"] for score in scores)
        worst_deg = max(score["max_deg"] for score in scores)
        medians = ", ".join(f"{100 * score['median_m']:.2f}" for score in scores)
        lost = sum(score["lost"] for score in scores)
        unchanged = all(score["map_unchanged"] for score in scores)
        return Measured(
            f"worst {100 * worst_m:.2f} cm, {worst_deg:.2f} degrees (medians: {medians} cm); {lost} of "
            f"{sum(score['overlapping'] for score in scores)} lost; "
            f"map {'unchanged' if unchanged else 'CHANGED'}",
            unchanged and all(score["all_within"] for score in scores),
            {"scores": scores},
            worst_m,
            "lower",
        )

    what = (
        f"{sequence}, a map saved of its first half: poses of frames of the second half that see half of "
        "what they see on surfaces that the map's keyframes saw; file and parameters of the map"
    )
    bound = "2 cm, 1 degree, none lost; the same bytes"
    return Check(f"localise:{sequence}", what, bound, measure)
