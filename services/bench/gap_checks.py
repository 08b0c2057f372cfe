"""A camera whose frames are missing now and then: a loaded machine, a weak cable."""

from hsslam_node.services.bench.camera_scores import Scores, camera_scores, wrong_poses
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("house-kinect", "livingroom", "kitchen", "apartment-kinect")
_MOST_FRAMES = "900"  # of the apartment's 2202 enough
_FEWEST = 0.9  # of the gaps


def gap_checks() -> list[Check]:
    """Two rows a sequence: tracked at once, and nothing wrong believed."""
    return [check for sequence in _SEQUENCES for check in _checks(sequence)]


def _checks(sequence: str) -> list[Check]:
    frames = ("--frames", _MOST_FRAMES) if sequence.startswith("apartment") else ()

    def scored(session: Session) -> Scores:
        return camera_scores(session, "gap_run", sequence, *frames)

    def found(session: Session) -> Measured:
        scores = scored(session)
        gaps, at_once, found = (
            sum(score[name] for score in scores) for name in ("gaps", "at_once", "found")
        )
        share = at_once / gaps
        text = f"{at_once} of {gaps} at once, {found} before the next gap"
        return Measured(text, share >= _FEWEST, {"scores": scores}, share, "higher")

    of = f"{sequence}, up to 30 frames (75 cm, 40 degrees) missing after every 8 to 15, all seeds"
    name = f"gaps:{sequence}"
    return [
        Check(f"{name}:found", f"{of}: tracked with the first frame after", "90 %", found),
        wrong_poses(name, of, scored),
    ]
