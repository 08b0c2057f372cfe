"""Names of the files of a fragment; apart, as the savers of trajectories need no tracker."""

from pathlib import Path

FRAGMENTS_NOT_SAVED = "fragments_not_saved"  # in the summary of the tracker, reasons by number
_TRAJECTORY, _MAP = "trajectory_fragment_", "map_fragment_"


def fragment_trajectory_name(number: int) -> str:
    """Without the suffixes of epoch and file."""
    return f"{_TRAJECTORY}{number}"


def fragment_map_name(number: int) -> str:
    """The name of the file; numbers go on after a reset of the map."""
    return f"{_MAP}{number}.safetensors"


def trajectory_beside(map_file: Path) -> Path:
    """The file of the trajectory in the world of a map of a run, or of a fragment of it."""
    if map_file.name.startswith(_MAP):
        stem = f"{_TRAJECTORY}{map_file.stem.removeprefix(_MAP)}"
        found = sorted(map_file.parent.glob(f"{stem}.*txt"))  # of an ended map epoch: .epoch0.txt
        return found[0] if found else map_file.with_name(f"{stem}.txt")
    return map_file.with_name("trajectory.txt")
