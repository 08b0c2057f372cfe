"""Whether a run folder is there whole; alone because results go to a folder or to a store."""

from pathlib import Path

from hsslam_services.run.summary import SUMMARY_FILE


def expect_whole(run_dir: Path) -> None:
    """Check that a run folder has not been removed, as by a `run` that clears `.work` of earlier attempts.

    Raises:
        OSError: the folder or its summary.json is missing.
    """
    if not (run_dir / SUMMARY_FILE).is_file():  # the last file that a run writes
        raise OSError(f"{run_dir}: no {SUMMARY_FILE}: expected a run folder that is whole")
