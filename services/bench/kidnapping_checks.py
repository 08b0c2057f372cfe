"""A camera that is carried to places seen before, twenty times."""

from hsslam_node.services.bench.camera_scores import Scores, camera_scores, wrong_poses
from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import Session

_SEQUENCES = ("house", "house-kinect", "livingroom", "livingroom-kinect", "kitchen")
_FEWEST = 0.9  # of the jumps


def kidnapping_checks() -> list[Check]:
    """Two rows a sequence: found again, and nothing wrong believed."""
    return [check for sequence in _SEQUENCES for check in _checks(sequence)]


def _checks(sequence: str) -> list[Check]:
    def scored(session: Session) -> Scores:
        return camera_scores(session, "kidnapping_run", sequence)

    def found(session: Session) -> Measured:
        scores = scored(session)
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

    of = f"{sequence}, 20 jumps to a place seen before, each of the seeds"
    name = f"kidnapping:{sequence}"
    return [
        Check(f"{name}:found", f"{of}: relocalised within 10 frames", "18 of 20", found),
        wrong_poses(name, of, scored),
    ]
