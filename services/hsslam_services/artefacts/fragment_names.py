"""Names of the other files of a fragment; apart, as the savers of trajectories need no tracker."""

from pathlib import Path

from hsslam_node.fragments.fragment_name import FRAGMENT_MAP

FRAGMENTS_NOT_SAVED = "fragments_not_saved"  # in the summary of the tracker, reasons by number
_TRAJECTORY = "trajectory_fragment_"


def fragment_trajectory_name(number: int) -> str:
    """Without the suffixes of epoch and file."""
    return f"{_TRAJECTORY}{number}"


def trajectory_beside(map_file: Path) -> Path:
    """The file of the trajectory in the world of a map of a run, or of a fragment of it."""
    if map_file.name.startswith(FRAGMENT_MAP):
        stem = f"{_TRAJECTORY}{map_file.stem.removeprefix(FRAGMENT_MAP)}"
        found = sorted(map_file.parent.glob(f"{stem}.*txt"))  # of an ended map epoch: .epoch0.txt
        return found[0] if found else map_file.with_name(f"{stem}.txt")
    return map_file.with_name("trajectory.txt")
