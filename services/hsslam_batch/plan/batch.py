"""The configuration of a batch, and the files of its folder.

OUT/batch.json          hash of the configuration, code and its digest, folder of the logs
OUT/config.toml         options of every run, as `hsslam-serve --config` reads them
OUT/manifest.parquet    a row a log
OUT/runs/ID/            the run folder of a log; its row `_DONE.json` is written last
OUT/rrd/ID.rrd          its recording for rerun; further parts are in OUT/rrd.1/ID.rrd, OUT/rrd.2/ID.rrd, ...
OUT/failed/ID.json      the row of a log that has no result
OUT/ray.log             what Ray prints while the batch runs
OUT/.work/ID.N.RANDOM/  the N-th attempt at a log, while it runs
OUT/.work/BATCH.ID.log/ a log of a store, from its fetch to the end of its run

If OUT is in a store, each machine has a folder with a copy of the plan and the attempts that run there.
"""

import contextlib
import functools
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

import msgspec

from hsslam_batch.plan.code import code_digest, code_name
from hsslam_batch.plan.listing import BATCH_FILE, MANIFEST
from hsslam_batch.plan.named_files import named_files_digest
from hsslam_batch.plan.remote_listing import is_url
from hsslam_batch.plan.store import Store
from hsslam_node.durable_file import write_durably
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import cache_root
from hsslam_node.user_path import user_path
from hsslam_services.run.config_file import CONFIG_FILE, config_text
from hsslam_services.run.options import ServeOptions

DONE = "_DONE.json"
FETCHED = ".log"
"""End of the names of folders for fetched logs."""
_DIGEST_BYTES = 8


class UnavailableError(UserError):
    """The folder or the store of a batch fails; the same command may work later."""


class OtherPlanError(UserError):
    """The code or the plan of a batch has changed since `hsslam-batch plan` or since the run began."""


class BatchFile(msgspec.Struct, frozen=True):
    """`batch.json`."""

    configuration: str  # hash of options, code and files that options name
    code: str  # version and commit
    logs: str  # the folder that was searched
    digest: str = ""  # of the code; earlier versions wrote none
    files: str = ""  # digest of mask and map; empty without them


@dataclass(frozen=True)
class Batch:
    """A planned batch. `out`: its folder on this machine; `url`: the store for results, empty without one.

    `patience_s`: how long this process waits for a store that fails.
    """

    out: Path
    about: BatchFile
    url: str = ""
    patience_s: float = field(default=0.0, compare=False)

    @property
    def place(self) -> str:
        """Folder or URL of the batch, as users write it."""
        return self.url or str(self.out)

    @property
    def key(self) -> str:
        """A digest of folder or URL, for names outside of the batch."""
        return _digest(self.place)

    @functools.cached_property
    def store(self) -> Store | None:
        """The store for results; None: they go to the folder.

        Raises:
            UserError: unknown kind of URL, or its package is missing.
        """
        return Store(self.url, self.patience_s) if self.url else None

    def name(self, path: Path) -> str:
        """The name in the store of a path of the folder."""
        return path.relative_to(self.out).as_posix()

    def publish(self, name: str) -> None:
        """Copy a file of the folder to the store, if results go to one.

        Raises:
            OSError: the store fails.
        """
        if self.store is not None:
            self.store.write(name, (self.out / name).read_bytes())

    @property
    def config(self) -> Path:
        """The options of every run."""
        return self.out / CONFIG_FILE

    @property
    def work(self) -> Path:
        """Folder of running attempts."""
        return self.out / ".work"

    def works(self) -> Iterator[Path]:
        """This folder; with results in a store also those of all other such batches on this machine."""
        return self.out.parent.glob(f"*/{self.work.name}") if self.url else iter([self.work])

    def run_dir(self, log_id: str) -> Path:
        """The run folder of a log, once it is done."""
        return self.out / "runs" / log_id

    def done_file(self, log_id: str) -> Path:
        """The row of a log that is done; a log without it is not done."""
        return self.run_dir(log_id) / DONE

    def failed_file(self, log_id: str) -> Path:
        """The row of a log whose last attempt failed."""
        return self.out / "failed" / f"{log_id}.json"

    def rrd_file(self, log_id: str, part: int = 0) -> Path:
        """The recording of a log, in one folder with those of others, as a data set of rerun.

        Each part has a folder: all have the same recording id, of which a data set takes one file.
        """
        return self.out / (f"rrd.{part}" if part else "rrd") / f"{log_id}.rrd"

    def rrd_files(self, log_id: str = "*") -> Iterator[Path]:
        """All parts of the recording of a log that are there, or of all logs."""
        return self.out.glob(f"rrd*/{log_id}.rrd")

    @contextlib.contextmanager
    def expect_writable(self) -> Iterator[None]:
        """Raise UnavailableError for any OSError in the block.

        Raises:
            UnavailableError: the folder or the store is not writable.
        """
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            raise UnavailableError(
                f"{self.place}: {reason}: expected a folder that can be written"
            ) from None

    def expect_same_code(self) -> None:
        """Raises:
        OtherPlanError: this code, the file with the options, or a file that an option names differs from
            that of the plan.
        """
        if (digest := code_digest()) != self.about.digest:
            raise OtherPlanError(
                f"{self.place}: was planned with {self.about.code} ({self.about.digest}), this is "
                f"{code_name()} ({digest}): expected the same code, or a new plan"
            )
        try:
            text = self.config.read_text(errors="surrogateescape")
        except OSError as error:
            raise OtherPlanError(
                f"{self.config}: {error.strerror}: expected the options of the plan, or a new plan"
            ) from None
        if _digest(f"{digest}\n{text}{self.about.files}") != self.about.configuration:
            raise OtherPlanError(
                f"{self.config}: has changed since hsslam-batch plan: expected a new plan for other options"
            )
        try:
            files = named_files_digest(text)
        except OSError as error:
            raise OtherPlanError(
                f"{error.filename}: {error.strerror}: expected the mask and map of the plan, or a new plan"
            ) from None
        if files != self.about.files:
            raise OtherPlanError(
                f"{self.config}: its mask or map has changed since hsslam-batch plan: expected the same "
                "files, or a new plan"
            )


def _digest(text: str) -> str:
    data = text.encode("utf-8", "surrogateescape")
    return hashlib.blake2b(data, digest_size=_DIGEST_BYTES).hexdigest()


def folder_of(out: str) -> tuple[Path, str]:
    """The folder of a batch on this machine, and its URL (empty for a folder or a `file://` URL).

    Raises:
        UserError: the `file://` URL names another machine or no path.
    """
    if not is_url(out):
        return user_path(out).absolute(), ""
    parts = urlsplit(out)
    if parts.scheme == "file":
        if parts.netloc not in ("", "localhost") or not parts.path:
            raise UserError(f"{out}: expected a folder as file:///FOLDER")
        return Path(unquote(parts.path)), ""
    url = out.rstrip("/")
    return cache_root() / "batch" / _digest(url), url


def planned_batch(out: Path, options: ServeOptions, logs: str, url: str = "") -> tuple[Batch, str]:
    """The batch of these options, without source and run folder, and the text of its configuration.

    Raises:
        UserError: mask or map cannot be read.
    """
    text, code = config_text(options), code_digest()
    try:
        files = named_files_digest(text)
    except OSError as error:
        raise UserError(
            f"{error.filename}: {error.strerror}: expected a mask or map that can be read"
        ) from None
    about = BatchFile(_digest(f"{code}\n{text}{files}"), code_name(), logs, code, files)
    return Batch(out, about, url), text


def write_batch(batch: Batch, text: str) -> None:
    """Write the configuration; the manifest is there.

    Raises:
        OSError: the folder or the store cannot be written.
    """
    write_durably(batch.config, text.encode())
    write_durably(batch.out / BATCH_FILE, msgspec.json.format(msgspec.json.encode(batch.about)))
    for name in (MANIFEST, CONFIG_FILE, BATCH_FILE):
        batch.publish(name)
