"""A camera that is carried to places seen before, twenty times."""

import json
from typing import Any

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("house", "house-kinect", "livingroom", "livingroom-kinect", "kitchen")
_FEWEST = 0.9  # of the jumps


def kidnapping_checks() -> list[Check]:
    """Two rows a sequence: found again, and nothing wrong believed."""
    return [check for sequence in _SEQUENCES for check in _checks(sequence)]


def _checks(sequence: str) -> list[Check]:
    def found(session: Session) -> Measured:
        scores = _scores(session, sequence)
        counts = [(score["relocalised"], score["jumps"]) for score in scores]
        needed = [n for score in scores for n in score["frames_needed"] if n]
        slowest = max(score["slowest_lost_ms"] for score in scores)
        each = ", ".join(f"{n} of {jumps}" for n, jumps in counts)
        fewest = min(n / jumps for n, jumps in counts)
        return Measured(
            f"{each}; after {max(needed, default=0)} frames at most; slowest lost frame {slowest:.0f} ms",
            fewest >= _FEWEST,
            {"scores": scores},
            fewest,
            "higher",
        )

    def wrong(session: Session) -> Measured:
        scores = _scores(session, sequence)
        count = sum(score["wrong"] for score in scores)
        worst_m = max(score["worst_m"] for score in scores)
        worst_deg = max(score["worst_deg"] for score in scores)
        return Measured(
            f"{count}; worst frame {100 * worst_m:.1f} cm, {worst_deg:.1f} degrees",
            count == 0,
            {"scores": scores},
            float(count),
            "lower",
        )

    of = f"{sequence}, 20 jumps to a place seen before, each of the seeds"
    name = f"kidnapping:{sequence}"
    return [
        Check(f"{name}:found", f"{of}: relocalised within 10 frames", "18 of 20", found),
        Check(f"{name}:wrong", f"{of}: poses accepted that are 10 cm or 5 degrees off", "0", wrong),
    ]


def _scores(session: Session, sequence: str) -> list[dict[str, Any]]:
    place, _, noise = sequence.partition("-")
    source = session.source(place)
    module = f"{__package__}.kidnapping_run"
    options = ("--noise", noise) if noise else ()
    return [
        json.loads(session.python(module, source, str(seed), *options)) for seed in session.seeds
    ]
