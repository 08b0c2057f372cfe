"""How well the map of the default preset draws frames that it was not made of: rows measured by name."""

from statistics import fmean
from typing import Any

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.serve_run import RunFailedError, finished
from hsslam_bench.runs.session import Session

_BOUNDS_DB = {"livingroom": 30.0, "kitchen": 25.0, "house": None, "house-kinect": None}


def rendering_checks() -> list[Check]:
    """One check for each sequence."""
    return [_check(sequence, bound_db) for sequence, bound_db in _BOUNDS_DB.items()]


def _check(sequence: str, bound_db: float | None) -> Check:
    def measure(session: Session) -> Measured:
        found = {str(seed): _scores(session, sequence, seed) for seed in session.seeds}
        views = [score["views"] for score in found.values()]
        psnr_db = fmean(score["psnr_db"] for score in views)
        images = sum(score["images"] for score in views)
        field = _text([score["field"] for score in found.values()])
        return Measured(
            f"{_text(views)}; field alone {field}; {images} images",
            None if bound_db is None else psnr_db >= bound_db,
            found,
            psnr_db,
            "higher",
        )

    what = (
        f"{sequence}, lockstep: PSNR, mean of the seeds, of every fifth frame that is no keyframe, drawn "
        "from the saved map as hsslam-render does, with colours of keyframes; SSIM; both also by the field "
        "alone, at the measured depth, as the literature does"
    )
    bound = "" if bound_db is None else f"{bound_db:g} dB"
    return Check(f"rendering:{sequence}", what, bound, measure, by_name_only=True)


def _scores(session: Session, sequence: str, seed: int) -> dict[str, Any]:
    """Scores of a run's images: `views` as users draw them, `field` by the field alone."""
    run = finished(session.mapped(sequence, seed))
    found = session.scores(run, "rendering")
    if not found.get("views", {}).get("images"):
        raise RunFailedError(f"{run.name}: no frame was drawn")
    return {"views": found["views"], "field": found["rendering"]}


def _text(scores: list[dict[str, Any]]) -> str:
    each = ", ".join(f"{score['psnr_db']:.2f}" for score in scores)
    similarity = fmean(score["ssim"] for score in scores)
    return f"{fmean(score['psnr_db'] for score in scores):.2f} dB (seeds: {each}), SSIM {similarity:.3f}"
