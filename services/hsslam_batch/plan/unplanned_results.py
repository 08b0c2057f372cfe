"""Finds results of logs that are not in the plan: the logs were changed, moved or removed since their run."""

from collections.abc import Iterable
from typing import NamedTuple

from hsslam_batch.plan.batch import Batch
from hsslam_batch.plan.folder_size import folder_nbytes
from hsslam_batch.plan.log import Log


class UnplannedResults(NamedTuple):
    """Number of folders with results that belong to no log of a plan, and the bytes of their files."""

    count: int
    nbytes: int

    def line(self) -> str:
        """Both in one line."""
        folders = "1 folder is" if self.count == 1 else f"{self.count} folders are"
        return (
            f"runs/: {folders} of no log of this plan and not removed, {self.nbytes / 1e9:.2f} GB"
        )


def unplanned_results(batch: Batch, logs: Iterable[Log]) -> UnplannedResults:
    """Compare the folders of results with a plan. Only if one belongs to no log, look for the sizes.

    In a store this takes one listing of folders, and one of all files of results if one belongs to no log.

    Raises:
        OSError: the folder or the store of the batch cannot be read.
    """
    runs, planned = batch.run_dir("any").parent, {log.id for log in logs}
    if batch.store is None:
        folders = [path for path in runs.iterdir() if path.is_dir()] if runs.exists() else []
        unplanned = [path for path in folders if path.name not in planned]
        return UnplannedResults(len(unplanned), sum(map(folder_nbytes, unplanned)))
    names = {*batch.store.folders(batch.name(runs))} - planned
    sizes = batch.store.sizes(batch.name(runs)) if names else {}
    nbytes = sum(size for path, size in sizes.items() if path.partition("/")[0] in names)
    return UnplannedResults(len(names), nbytes)
