"""Whether two runs have left the same trajectories."""

from collections.abc import Sequence

from hsslam_node.services.bench.serve_run import ServeRun

TRAJECTORIES = ("trajectory.txt", "trajectory_online.txt", "keyframes.txt")


def different_files(runs: Sequence[ServeRun]) -> list[str]:
    """Names of the trajectories that are not the same byte for byte, or missing."""
    return [name for name in TRAJECTORIES if not _are_same(runs, name)]


def _are_same(runs: Sequence[ServeRun], name: str) -> bool:
    paths = [run.folder / name for run in runs]
    return all(p.exists() for p in paths) and len({p.read_bytes() for p in paths}) == 1
