"""One log of a batch, and the manifest that lists all of them: a Parquet file with a row a log."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from hsslam_batch.plan.batch import MANIFEST, UnavailableError
from hsslam_batch.plan.parquet_rows import read_rows, write_rows
from hsslam_node.errors import UserError

_DIGEST_BYTES = 8


@dataclass(frozen=True)
class Log:
    """A recording that becomes one run.

    `id`: a digest of name, size and version, so it changes if the recording does.
    """

    index: int  # row in the manifest
    id: str
    name: str  # path below the folder that was searched
    kind: str  # of the source: mcap, tum, replica, ...
    place: str  # absolute path, or URL
    nbytes: int
    version: str  # digest of the files' names, sizes and times of change (store: tags)
    frames: int  # that the run uses; 0: not known before the run
    # of the files beside it that are fetched with it; none of them is in `nbytes`
    beside_nbytes: int = 0

    @property
    def source(self) -> str:
        """The value for `hsslam-serve --source`; a log of a URL must be fetched before."""
        return f"{self.kind}:{self.place}"


def log_id(name: str, nbytes: int, version: str) -> str:
    """The digest that names the results of a log; 16 hexadecimal digits."""
    text = "\0".join((name, str(nbytes), version))
    return hashlib.blake2b(text.encode(), digest_size=_DIGEST_BYTES).hexdigest()


def write_manifest(out: Path, logs: Sequence[Log]) -> None:
    """Write the list of all logs in one step.

    Raises:
        OSError: the folder is not writable.
    """
    columns = {field.name: int if field.type is int else str for field in fields(Log)}
    write_rows(out / MANIFEST, [asdict(log) for log in logs], columns)


def read_manifest(out: Path) -> list[Log]:
    """All logs, in the order of their index.

    Raises:
        UserError: the manifest is missing or of another version.
        UnavailableError: the disk does not give it.
    """
    path = out / MANIFEST
    try:
        return [Log(**row) for row in read_rows(path)]
    except (FileNotFoundError, NotADirectoryError):
        raise UserError(f"{out}: no {MANIFEST}: expected a folder of hsslam-batch plan") from None
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0]
        # pyarrow gives no errno if the content is bad
        if isinstance(error, OSError) and error.errno is not None:
            raise UnavailableError(f"{path}: {reason}: expected a disk that can be read") from None
        raise UserError(f"{path}: {reason}: expected a file of hsslam-batch plan") from None
