"""A bound that grows: the apartment without a bound given, and its first room before and after."""

from dataclasses import asdict

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.first_room import first_room, score_first_room
from hsslam_node.services.bench.serve_run import finished
from hsslam_node.services.bench.session import QUICK_FRAMES, Session

_SEQUENCE = "apartment-kinect"
_FIRST_FRAMES = 300  # in the first room
_NO_WORSE = 1.05  # times: what two runs of one room differ by anyway


def map_checks() -> list[Check]:
    """One check: accuracy on the apartment itself is among those of the trajectories."""
    return [
        Check(
            "bound-growth:first-room",
            f"{_SEQUENCE}, no bound given: mesh of what the first {_FIRST_FRAMES} frames saw, after the "
            "whole run against after those frames: mean accuracy; completion within 5 cm",
            "no worse (5%)",
            _first_room,
        )
    ]


def _first_room(session: Session) -> Measured:
    frames = QUICK_FRAMES // 2 if session.quick else _FIRST_FRAMES
    whole = finished(session.lockstep(_SEQUENCE))
    start = finished(session.lockstep(_SEQUENCE, frames=frames))
    room = first_room(session.source("apartment"), frames)
    before, after = (score_first_room(room, run.folder) for run in (start, whole))
    mapper = whole.summary.get("processes", {}).get("mapper", {})
    growths = mapper.get("counters", {}).get("growths", 0)
    lost_before = 1.0 - before.completion_ratio_5cm
    lost_after = 1.0 - after.completion_ratio_5cm
    return Measured(
        f"{100 * after.accuracy_mean_m:.2f} against {100 * before.accuracy_mean_m:.2f} cm; "
        f"{after.completion_ratio_5cm:.1%} against {before.completion_ratio_5cm:.1%}; "
        f"{growths} growths",
        after.accuracy_mean_m <= _NO_WORSE * before.accuracy_mean_m
        and lost_after <= _NO_WORSE * lost_before,
        {"before": asdict(before), "after": asdict(after), "growths": growths},
        after.accuracy_mean_m,
        "lower",
    )
