"""Whether a log of this machine is still the planned one; alone, as `fetch.py` checks logs of a store."""

from pathlib import Path

from hsslam_batch.plan.batch import UnavailableError
from hsslam_batch.plan.find_logs import RECORDED, planned_files
from hsslam_batch.plan.listing import list_folder
from hsslam_batch.plan.log import Log
from hsslam_node.errors import UserError


def expect_unchanged(log: Log, out: Path) -> None:
    """Check sizes and times of the files of a log against the plan of the batch in `out`.

    A log that had no end when it was planned, so that its `frames` are 0, may change: its first reader
    completes it. A log that is not there, as on a node without its disk, is no other log.

    Raises:
        UserError: it is another log now.
        UnavailableError: the disk cannot be read.
    """
    has_no_end = log.kind == RECORDED and not log.frames
    if has_no_end or not Path(log.place).exists():
        return
    try:
        files = list_folder(Path(log.place), str(out))
    except UserError as error:  # the disk fails, not the log
        raise UnavailableError(str(error)) from None
    planned_files(files, log)
