"""Rows of cameras that miss frames, are kidnapped, or localise in a saved map: scores over the seeds."""

from collections.abc import Callable
from typing import Any

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import Session

Scores = list[dict[str, Any]]
_GAP_SEQUENCES = ("house-kinect", "livingroom", "kitchen", "apartment-kinect")
_MOST_FRAMES = "900"  # of the apartment's 2202
_FEWEST_GAPS = 0.9  # of the gaps
_KIDNAPPING_SEQUENCES = ("house", "house-kinect", "livingroom", "livingroom-kinect", "kitchen")
_FEWEST_KIDNAPPINGS = 0.9  # of the jumps
_LOCALISE_SEQUENCES = ("livingroom",)


def camera_scores(session: Session, script: str, sequence: str, *options: str) -> Scores:
    """Run a script of the benchmark on a sequence such as "house-kinect"; one score a seed.

    Raises:
        Skipped: the sequence is not on disk.
    """
    place, _, noise = sequence.partition("-")
    noisy = ("--noise", noise) if noise else ()
    source = session.source(place)
    return [session.figures(script, source, str(seed), *noisy, *options) for seed in session.seeds]


def wrong_poses(name: str, of: str, scored: Callable[[Session], Scores]) -> Check:
    """The row that counts wrong poses that were accepted; `of`: the sequence and what happens in it."""

    def wrong(session: Session) -> Measured:
        scores = scored(session)
        count = sum(score["wrong"] for score in scores)
        worst_m = max(score["worst_m"] for score in scores)
        worst_deg = max(score["worst_deg"] for score in scores)
        text = f"{count}; worst frame {100 * worst_m:.1f} cm, {worst_deg:.1f} degrees"
        return Measured(text, count == 0, {"scores": scores}, float(count), "lower")

    what = f"{of}: poses accepted that are 10 cm or 5 degrees off"
    return Check(f"{name}:wrong", what, "0", wrong)


def gap_checks() -> list[Check]:
    """Two rows a sequence: frames tracked at once after a gap, and wrong poses accepted."""
    return [check for sequence in _GAP_SEQUENCES for check in _gap_checks(sequence)]


def _gap_checks(sequence: str) -> list[Check]:
    frames = ("--frames", _MOST_FRAMES) if sequence.startswith("apartment") else ()

    def scored(session: Session) -> Scores:
        return camera_scores(session, "hsslam_bench.scripts.gap_run", sequence, *frames)

    def found(session: Session) -> Measured:
        scores = scored(session)
        gaps, at_once, found = (
            sum(score[name] for score in scores) for name in ("gaps", "at_once", "found")
        )
        share = at_once / gaps
        text = f"{at_once} of {gaps} at once, {found} before the next gap"
        return Measured(text, share >= _FEWEST_GAPS, {"scores": scores}, share, "higher")

    of = f"{sequence}, up to 30 frames (75 cm, 40 degrees) missing after every 8 to 15, all seeds"
    name = f"gaps:{sequence}"
    return [
        Check(f"{name}:found", f"{of}: tracked with the first frame after", "90 %", found),
        wrong_poses(name, of, scored),
    ]


def kidnapping_checks() -> list[Check]:
    """Two rows a sequence: jumps after which the camera is relocalised, and wrong poses accepted."""
    return [check for sequence in _KIDNAPPING_SEQUENCES for check in _kidnapping_checks(sequence)]


def _kidnapping_checks(sequence: str) -> list[Check]:
    def scored(session: Session) -> Scores:
        return camera_scores(session, "hsslam_bench.scripts.kidnapping_run", sequence)

    def found(session: Session) -> Measured:
        scores = scored(session)
        counts = [(score["relocalised"], score["jumps"]) for score in scores]
        needed = [n for score in scores for n in score["frames_needed"] if n]
        slowest = max(score["slowest_lost_ms"] for score in scores)
        each = ", ".join(f"{n} of {jumps}" for n, jumps in counts)
        fewest = min(n / jumps for n, jumps in counts)
        return Measured(
            f"{each}; after {max(needed, default=0)} frames at most; slowest lost frame {slowest:.0f} ms",
            fewest >= _FEWEST_KIDNAPPINGS,
            {"scores": scores},
            fewest,
            "higher",
        )

    of = f"{sequence}, 20 jumps to a place seen before, each of the seeds"
    name = f"kidnapping:{sequence}"
    return [
        Check(f"{name}:found", f"{of}: relocalised within 10 frames", "18 of 20", found),
        wrong_poses(name, of, scored),
    ]


def localise_checks() -> list[Check]:
    """One row a sequence."""
    return [_check(sequence) for sequence in _LOCALISE_SEQUENCES]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        source = session.source(sequence)
        module = "hsslam_bench.scripts.localise_run"
        scores = [session.figures(module, source, str(s)) for s in session.seeds]
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
