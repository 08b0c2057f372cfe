"""Rows of a lost camera: its fragment joins the map where they meet, and joins no lookalike room."""

from functools import partial

from hsslam_bench.checks.accuracy import Accuracy
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session
from hsslam_node.config.tracking import NEW_MAP_AFTER_S

_DARK = range(672, 732)  # 2 s: the doorway from the kitchen to the study
_LONG_DARK = range(672, 852)  # 6 s: it is light again in the study, which the map does not know
_SEES_S = 1.0  # before a fragment begins
_FRAMES = 2400  # one round, and on into the first room
_RATE_HZ = 30
_FACTOR = 1.5  # of the ATE without darkness
_ROOMS = "hsslam_bench.joining.lookalike_rooms"


def lost_checks() -> list[Check]:
    """The rows of a walk through darkness and of rooms that look alike."""
    return [
        Check(
            "lost:apartment",
            f"apartment, {_FRAMES} frames, lockstep, 2 s of darkness in a doorway: ATE RMSE, final, mean of "
            "the seeds; in the end all frames are in one map, but for those of the first "
            f"{NEW_MAP_AFTER_S:g} s from the darkness on",
            f"{_FACTOR:g} x without darkness",
            partial(_apartment, dark=_DARK, joins=0),
            by_name_only=True,
            is_lockstep=True,
        ),
        Check(
            "lost:fragment",
            "as lost:apartment with 6 s of darkness, so that a fragment begins in the next room and joins "
            "when the camera is back in the first one; in the end all frames are in one map, but for those "
            f"from the darkness on until {_SEES_S:g} s after it",
            f"{_FACTOR:g} x without darkness; the fragment joins",
            partial(_apartment, dark=_LONG_DARK, joins=1),
            by_name_only=True,
            is_lockstep=True,
        ),
        Check(
            "lost:lookalike",
            "30 rooms of one plan with the same furniture, 320x240, keyframes at their true poses, the map "
            "knows one room and the fragment the next: joins that are 10 cm off; and five fragments in the "
            "room that the map knows",
            "0; 5 of 5 joined",
            _lookalike,
            by_name_only=True,
        ),
    ]


def _apartment(session: Session, dark: range, joins: int) -> Measured:
    """`joins`: fragments that must begin and join."""
    darkened = [finished(session.darkened("apartment", s, _FRAMES, dark)) for s in session.seeds]
    light = [finished(session.darkened("apartment", s, _FRAMES, range(0))) for s in session.seeds]
    found, plain = Accuracy.of(darkened), Accuracy.of(light)
    bound_m = _FACTOR * plain.mean_m
    lost_s = max(len(dark) / _RATE_HZ + _SEES_S, NEW_MAP_AFTER_S)
    unavoidable = round(_RATE_HZ * lost_s) + 1
    fragments = [_fragments(run) for run in darkened]
    each = ", ".join(f"{joined} of {begun}" for begun, joined in fragments)
    ok = (
        found.mean_m <= bound_m
        and found.lost <= unavoidable * len(darkened)
        and all(begun == joined and joins <= joined <= 1 for begun, joined in fragments)
    )
    return Measured(
        f"{100 * found.mean_m:.3f} cm (seeds: {found.each_cm(3)}), without darkness "
        f"{100 * plain.mean_m:.3f} cm (seeds: {plain.each_cm(3)}); {each} fragments joined, "
        f"{found.lost} frames lost",
        ok,
        {**found.values(bound_m), "plain_m": plain.errors_m, "fragments": fragments},
        found.mean_m / max(plain.mean_m, 1e-9),
        "lower",
    )


def _fragments(run: ServeRun) -> tuple[int, int]:
    """Number of fragments, and number of joined fragments."""
    fragments = run.summary.get("fragments", {}).values()
    return len(fragments), sum(fragment["joined"] for fragment in fragments)


def _lookalike(session: Session) -> Measured:
    scores = [session.figures(_ROOMS, str(seed)) for seed in session.seeds]
    wrong, right, pairs, joined, controls = (
        sum(score[name] for score in scores)
        for name in ("wrong", "through_a_door", "pairs", "joined", "controls")
    )
    return Measured(
        f"{wrong} of {pairs} pairs, {right} joined right by what a door shows of both; {joined} of "
        f"{controls} controls joined",
        wrong == 0 and joined == controls,
        {"scores": scores},
        float(wrong),
        "lower",
    )
