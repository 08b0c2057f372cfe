"""Whether a run folder is there whole; alone because results go to a folder or to a store."""

from pathlib import Path

_SUMMARY = "summary.json"  # the last file that a run writes


def expect_whole(run_dir: Path) -> None:
    """Check that a run folder has not been removed, as by a `run` that clears `.work` of earlier attempts.

    Raises:
        OSError: the folder or its summary.json is missing.
    """
    if not (run_dir / _SUMMARY).is_file():
        raise OSError(f"{run_dir}: no {_SUMMARY}: expected a run folder that nobody removes")
