"""Whether a log of this machine is still the planned one; alone, as `fetch.py` checks logs of a store."""

from pathlib import Path

from hsslam_batch.plan.batch import UnavailableError
from hsslam_batch.plan.find_logs import RECORDED, planned_files
from hsslam_batch.plan.listing import ClosedError, is_there, list_folder
from hsslam_batch.plan.log import Log
from hsslam_node.errors import UserError


def expect_unchanged(log: Log, out: Path) -> bool:
    """Check sizes and times of the files of a log against the plan of the batch in `out`; returns whether the
    log is there.

    A log that had no end when it was planned, so that its `frames` are 0, may change: its first reader
    completes it. A log that is not there, as on a node without its disk, is no other log.

    Raises:
        UserError: it is another log now.
        ClosedError: this user may not read it.
        UnavailableError: the disk cannot be read.
    """
    try:
        if not is_there(Path(log.place)):
            return False
        if log.kind == RECORDED and not log.frames:
            return True
        files = list_folder(Path(log.place), str(out))
    except ClosedError:
        raise
    except UserError as error:  # the disk fails, not the log
        raise UnavailableError(str(error)) from None
    planned_files(files, log)
    return True
