"""The configuration of a batch, and where everything lies below its folder.

OUT/batch.json          hash of the configuration, code, folder of the logs
OUT/config.toml         options of every run, as `hsslam-serve --config` reads them
OUT/manifest.parquet    a row a log
OUT/runs/ID/            the run folder of a log; `_DONE.json`, its row, was written last
OUT/rrd/ID.rrd          its recording for rerun
OUT/failed/ID.json      the row of a log that has no result
OUT/.work/ID.N/         the N-th attempt at a log, while it goes on
"""

import contextlib
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from hsslam_node import __version__
from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError
from hsslam_services.run.config_file import CONFIG_FILE, config_text
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.summary import source_commit

DONE = "_DONE.json"
_FILE = "batch.json"
_DIGEST_BYTES = 8


class BatchFile(msgspec.Struct, frozen=True):
    """`batch.json`."""

    configuration: str  # hash of options and code
    code: str
    logs: str  # the folder that was searched


@dataclass(frozen=True)
class Batch:
    """A planned batch."""

    out: Path
    about: BatchFile

    @property
    def config(self) -> Path:
        """The options of every run."""
        return self.out / CONFIG_FILE

    @property
    def work(self) -> Path:
        """Where attempts lie while they go on."""
        return self.out / ".work"

    def run_dir(self, log_id: str) -> Path:
        """The run folder of a log, once it is done."""
        return self.out / "runs" / log_id

    def done_file(self, log_id: str) -> Path:
        """The row of a log that is done; nothing is done without it."""
        return self.run_dir(log_id) / DONE

    def failed_file(self, log_id: str) -> Path:
        """The row of a log whose last attempt failed."""
        return self.out / "failed" / f"{log_id}.json"

    def rrd_file(self, log_id: str) -> Path:
        """The recording of a log, in one folder with all others, as a data set of rerun."""
        return self.out / "rrd" / f"{log_id}.rrd"

    @contextlib.contextmanager
    def expect_writable(self) -> Iterator[None]:
        """In the block an OSError is that of a folder that cannot be written.

        Raises:
            UserError: in its place.
        """
        try:
            yield
        except OSError as error:
            raise UserError(
                f"{self.out}: {error.strerror}: expected a folder that can be written"
            ) from None

    def expect_same_code(self) -> None:
        """Raises:
        UserError: the batch was planned with other code than this.
        """
        if self.about.code != code():
            raise UserError(
                f"{self.out}: was planned with {self.about.code}, this is {code()}: expected the same "
                "code, or a new plan"
            )


def code() -> str:
    """Version and commit of this code."""
    return " ".join(part for part in (__version__, source_commit()) if part)


def write_batch(out: Path, options: ServeOptions, logs: str) -> Batch:
    """Write the configuration: `options` without source and run folder.

    Raises:
        OSError: the folder cannot be written.
    """
    text = config_text(options)
    digest = hashlib.blake2b(f"{code()}\n{text}".encode(), digest_size=_DIGEST_BYTES).hexdigest()
    batch = Batch(out, BatchFile(digest, code(), logs))
    write_durably(batch.config, text.encode())
    write_durably(out / _FILE, msgspec.json.format(msgspec.json.encode(batch.about)))
    return batch


def read_batch(out: Path) -> Batch:
    """The batch of a folder.

    Raises:
        UserError: the folder holds none, or one of another version.
    """
    out = out.absolute()
    try:
        about = msgspec.json.decode((out / _FILE).read_bytes(), type=BatchFile)
    except OSError as error:
        raise UserError(
            f"{out / _FILE}: {error.strerror}: expected a folder of hsslam-batch plan"
        ) from None
    except msgspec.MsgspecError as error:
        raise UserError(f"{out / _FILE}: {error}: expected a file of hsslam-batch plan") from None
    return Batch(out, about)
