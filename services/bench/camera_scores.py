"""How a camera fares that does not see all the time: scores of a script over the seeds."""

import json
from collections.abc import Callable
from typing import Any

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

Scores = list[dict[str, Any]]


def camera_scores(session: Session, script: str, sequence: str, *options: str) -> Scores:
    """What a script of this folder prints for a sequence such as "house-kinect", one score a seed.

    Raises:
        Skipped: the sequence is not on disk.
    """
    place, _, noise = sequence.partition("-")
    noisy = ("--noise", noise) if noise else ()
    module, source = f"{__package__}.{script}", session.source(place)
    return [
        json.loads(session.python(module, source, str(seed), *noisy, *options))
        for seed in session.seeds
    ]


def wrong_poses(name: str, of: str, scored: Callable[[Session], Scores]) -> Check:
    """The row that no wrong pose is believed; `of`: what the camera goes through."""

    def wrong(session: Session) -> Measured:
        scores = scored(session)
        count = sum(score["wrong"] for score in scores)
        worst_m = max(score["worst_m"] for score in scores)
        worst_deg = max(score["worst_deg"] for score in scores)
        text = f"{count}; worst frame {100 * worst_m:.1f} cm, {worst_deg:.1f} degrees"
        return Measured(text, count == 0, {"scores": scores}, float(count), "lower")

    what = f"{of}: poses accepted that are 10 cm or 5 degrees off"
    return Check(f"{name}:wrong", what, "0", wrong)
