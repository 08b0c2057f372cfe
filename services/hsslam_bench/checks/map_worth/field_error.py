"""Rows of the error of the map's zero level at the true surface, all measured only by name."""

from statistics import fmean

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.field_error.error_bins import Errors
from hsslam_bench.runs.session import Session

_SEQUENCES = ("house-kinect", "room-kinect", "house", "livingroom", "room")
_MODULE = "hsslam_bench.field_error.run"
_BIAS_M, _DEVIATION_M = 0.0003, 0.0012
_HELD = ("house-kinect", "room-kinect")


def field_error_checks() -> list[Check]:
    """One check for each sequence."""
    return [_field_error_check(sequence) for sequence in _SEQUENCES]


def _field_error_check(sequence: str) -> Check:
    is_held = sequence in _HELD

    def measure(session: Session) -> Measured:
        place, *changes = sequence.split("-")
        noise = ("--noise", "kinect") if "kinect" in changes else ()
        found = [
            session.figures(_MODULE, session.source(place), str(seed), *noise)
            for seed in session.seeds
        ]
        texts = []
        for name in ("distance", "sdf", "tsdf"):
            if all(name in one for one in found):
                mean = _mean([Errors(**one[name]["target"]) for one in found])
                texts.append(f"{name} {mean}")
        ours = _mean([Errors(**one["distance"]["target"]) for one in found])
        met = abs(ours.median_m) <= _BIAS_M and ours.robust_m <= _DEVIATION_M
        return Measured(
            "; ".join(texts),
            met if is_held else None,
            {str(seed): one for seed, one in zip(session.seeds, found, strict=True)},
            ours.robust_m,
            "lower",
        )

    bound = f"{1e3 * _BIAS_M:g} +- {1e3 * _DEVIATION_M:g} mm" if is_held else ""
    what = (
        f"{sequence}, mapped at true poses: the field's distance (its SDF over its slope) at the true "
        "surface of the next frames, 1 to 3 m away, that ten keyframes or more had seen: median, robust "
        "deviation (plain deviation); the SDF as it is; a TSDF of the same frames"
    )
    return Check(f"field-error:{sequence}", what, bound, measure, by_name_only=True)


def _mean(found: list[Errors]) -> Errors:
    return Errors(
        sum(one.points for one in found),
        *(
            fmean(getattr(one, name) for one in found)
            for name in ("told", "median_m", "mean_m", "robust_m", "deviation_m")
        ),
    )
