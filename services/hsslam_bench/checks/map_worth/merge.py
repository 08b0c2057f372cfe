"""Rows of merged maps: two sessions in one place merge, sessions in different places do not."""

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import Session

_SEQUENCES = ("apartment",)
_FACTOR = 1.2  # of the ATE of one run over all frames


def merge_checks() -> list[Check]:
    """A row a sequence, and one for different places."""
    strangers = Check(
        "merge:strangers",
        "rooms of the apartment against rooms of the mirror image of another apartment, and against the "
        "corridor, 320x240, keyframes at their true poses: pairs that would merge",
        "0",
        _strangers,
        by_name_only=True,
    )
    return [*(_check(sequence) for sequence in _SEQUENCES), strangers]


def _check(sequence: str) -> Check:
    def measure(session: Session) -> Measured:
        module, source = "hsslam_bench.joining.merge_run", session.source(sequence)
        scores = [session.figures(module, source, str(s)) for s in session.seeds]
        ratios = [score["merged_m"] / score["whole_m"] for score in scores]
        each, whole = (
            ", ".join(f"{100 * score[name]:.2f}" for score in scores)
            for name in ("merged_m", "whole_m")
        )
        places = ", ".join(str(score["places"]) for score in scores)
        return Measured(
            f"{each} cm, one run {whole}: {max(ratios):.2f} x at most; {places} places agree",
            all(ratio <= _FACTOR for ratio in ratios)  # NaN if a run has no ATE
            and all(s["scored"] == s["frames"] for s in scores),
            {"scores": scores},
            max(ratios),
            "lower",
        )

    what = (
        f"{sequence}, sessions over its first and its last 55 %, merged: ATE RMSE of all frames, against one "
        "run over the whole, worst seed"
    )
    return Check(f"merge:{sequence}", what, f"{_FACTOR:g} x", measure, by_name_only=True)


def _strangers(session: Session) -> Measured:
    scores = [
        session.figures("hsslam_bench.joining.strange_maps", str(seed)) for seed in session.seeds
    ]
    merged, pairs = (sum(score[name] for score in scores) for name in ("merged", "pairs"))
    most = max(score["most_places"] for score in scores)
    text = f"{merged} of {pairs}; at most {most} places of a pair agree"
    return Measured(text, merged == 0, {"scores": scores}, float(merged), "lower")
