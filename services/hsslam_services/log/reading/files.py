"""Finds the files of a log; recovers an unfinished one first, and refuses one that a run still writes."""

import fcntl
import os
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_node.user_path import user_path
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.parts import part_number, parts
from hsslam_services.log.reading.reader import log_reader
from hsslam_services.log.recovery import Recovered, locks_in_time, recover
from hsslam_services.log.whole_records import MAGIC
from hsslam_services.run.find_run import running_runs
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.source_table import log_place

Say = Callable[[str], None]
_STILL_S = 2.0  # an unfinished log that has changed since may be a copy in progress


def log_parts(place: str | Path, say: Say) -> list[Path]:
    """The readable files of a log: one MCAP file, or all parts in a run folder, in order.

    Recovers unfinished files; `say` takes a line about each. Leaves out parts without messages, of a
    recorder that was killed at once, if there are others.

    Raises:
        UserError: no such file or folder, no MCAP file, or a run still writes it.
    """
    found = log_files(place)
    for before, after in pairwise(found):
        if part_number(after) != part_number(before) + 1:
            say(f"{after}: the part before it is missing, after {before.name}: the log has a gap")
    for file in found:
        make_readable(file, say)
    return [file for file in found if len(found) == 1 or _has_messages(file)] or found


def _has_messages(path: Path) -> bool:
    with log_reader(path) as reader:
        summary = reader.get_summary()
        return not (summary and summary.statistics and summary.statistics.message_count == 0)


def log_files(place: str | Path) -> list[Path]:
    """The files of a log, without recovery.

    Raises:
        UserError: a folder without a log, or one that cannot be read.
    """
    path = user_path(place)
    try:
        if not path.is_dir():
            return [path]
        os.scandir(path).close()  # glob passes over a folder that cannot be read
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a log or a run folder") from None
    found = parts(path)
    if not found:
        raise UserError(f"{path}: no log there: expected a run folder with run.mcap")
    return found


def is_log(place: str) -> bool:
    """Whether `place` names a log, not a run folder."""
    return bool(log_place(place)) or place.endswith(".mcap")


def make_readable(path: Path, say: Say) -> bool:
    """Recover the file if it is unfinished, and report this by `say`; False if it is finished.

    Raises:
        UserError: the file cannot be read, is no MCAP file, is still written, or is unfinished and not ours.
    """
    try:
        with path.open("rb") as stream:
            first = stream.read(len(MAGIC))
            if not MAGIC.startswith(first) or not (first or _is_named_as_log(path)):
                raise UserError(f"{path}: not an MCAP file: expected a log such as run.mcap")
        expect_closed(path)
        if is_finished(path):
            return False
        recovered = _recovered(path)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: expected a log such as run.mcap") from None
    say(f"{path}: {recovered.line()}")
    return True


def _recovered(path: Path) -> Recovered:
    try:
        return recover(path)
    except PermissionError:
        raise UserError(
            f"{path}: its end is missing, and this user may not complete it: expected a file and a folder "
            "to write, such as a copy"
        ) from None


def _is_named_as_log(path: Path) -> bool:
    """Whether recovery may make a log of this file if it is empty."""
    return path.suffix == ".mcap"


def expect_closed(path: Path) -> None:
    """Check that nothing still writes the file: a run by its file lock, a copy in progress by a change.

    On a file system without locks, an unfinished log counts as being written while the run of its folder
    lives. Waits 2 s at most.

    Raises:
        UserError: a run or another program still writes the file.
        OSError: the file cannot be read.
    """
    with path.open("rb") as stream:
        try:
            is_written = not locks_in_time(stream, fcntl.LOCK_SH)
        except OSError:  # no locks
            is_written = not is_finished(path) and _run_lives(path.parent)
    if is_written:
        raise UserError(f"{path}: a run is still writing it: expected a log that is closed")
    if not is_finished(path) and not _is_where_it_was_recorded(path):
        _expect_no_change(path)


def _is_where_it_was_recorded(path: Path) -> bool:
    """Whether the log is in its run's own folder: there only the recorder writes it, which locks it."""
    with suppress(UserError, OSError):
        return path.parent.samefile(RunInfo.read(path.parent).run_dir)
    return False


def _expect_no_change(path: Path) -> None:
    """Check that the file stays as it is until its last change is `_STILL_S` old.

    Raises:
        UserError: it changes: it is being copied here.
        OSError: the file cannot be read.
    """
    before = path.stat()
    age_s = time.time() - before.st_mtime
    if age_s > _STILL_S:
        return
    time.sleep(min(_STILL_S - age_s, _STILL_S))
    after = path.stat()
    if (before.st_size, before.st_mtime_ns) != (after.st_size, after.st_mtime_ns):
        raise UserError(
            f"{path}: another program is writing it: expected a log that has been copied whole"
        )


def _run_lives(folder: Path) -> bool:
    return any(Path(place).exists() and Path(place).samefile(folder) for place in running_runs())
