"""One file of a log, open for reading."""

import errno
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader

from hsslam_node.errors import UserError

_TORN = (
    *(McapError, struct.error, ValueError, RuntimeError, EOFError, KeyError),
    *(OverflowError, MemoryError),  # of a size that is none
)


@contextmanager
def log_reader(path: Path) -> Iterator[McapReader]:
    """A reader that checks all sums; whatever a damaged file raises while it is read becomes one line.

    Raises:
        UserError: the file claims to be whole and is not.
    """
    with path.open("rb") as stream:
        try:
            yield make_reader(stream, validate_crcs=True)
        except _TORN as error:
            raise _damaged(path, error) from None
        except OSError as error:
            if error.errno != errno.EINVAL:  # of a place that no file has
                raise
            raise _damaged(path, error) from None


def start_ns(reader: McapReader) -> int:
    """Wall clock of the first message, ns; 0 where there is none."""
    summary = reader.get_summary()
    statistics = summary.statistics if summary else None
    return statistics.message_start_time if statistics else 0


def end_ns(reader: McapReader) -> int:
    """Wall clock of the last message, ns; 0 where there is none."""
    summary = reader.get_summary()
    statistics = summary.statistics if summary else None
    return statistics.message_end_time if statistics else 0


def _damaged(path: Path, error: Exception) -> UserError:
    return UserError(f"{path}: damaged ({error!s:.120}): expected a whole MCAP file")
