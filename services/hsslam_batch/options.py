"""The options of `hsslam-batch`: one frozen dataclass a subcommand."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from hsslam_node.errors import UserError

_MOST = 1e6  # cores, GB


@dataclass(frozen=True)
class PlanOptions:
    """Lists the logs below a folder and fixes the options of their runs; runs nothing.

    Every option of hsslam-serve may follow, as --preset paper or --config FILE. Without one, runs are as
    hsslam-serve makes them, with --pace lockstep and --viewer none.

    Examples:
      hsslam-batch plan recordings --out tonight --seed 1
      hsslam-batch run tonight

    The same folder can be planned again: logs that are done with the same options and code stay done.
    """

    POSITIONALS: ClassVar = ("logs",)
    VALUES: ClassVar = {"logs": "FOLDER", "out": "FOLDER"}

    logs: str = ""
    """Folder, or URL as s3://BUCKET/LOGS, below which logs and sequences are looked for."""
    out: str = ""
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""


@dataclass(frozen=True)
class WorkOptions:
    """Makes the run of one log, without Ray, for schedulers that start a task for each index.

    Exit codes: 0 if the log is done, 1 if the command is interrupted, 2 if the log is bad or the input is,
    3 if the run fails for another reason.

    Raises:
        UserError: a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {"out": "FOLDER", "id": "ID", "scratch": "FOLDER"}
    ALIASES: ClassVar = {"timeout_s": "--timeout", "memory_gb": "--memory"}

    out: str = "."
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""
    index: int = 0
    """Row of the log in the manifest, from 0."""
    id: str = ""
    """Id of the log; no run is made if the row has another (empty: any)."""
    attempt: int = 1
    """Number of this attempt at the log."""
    retries: int = 0
    """Attempts that may follow the first: what a failed fetch has brought stays for the next."""
    timeout_s: float | None = None
    """Seconds that fetch and run of the log may take together (none: no limit)."""
    memory_gb: float | None = None
    """Memory that its processes may take together, GB (none: no limit)."""
    scratch: Path | None = None
    """Folder for logs that are fetched (none: .work in the batch)."""
    fetch_gb: float = 100.0
    """Largest log that is fetched, GB."""
    json: bool = False
    """Print frames and result as lines of JSON."""
    tied: bool = False
    """End the run when standard input is closed."""

    def __post_init__(self) -> None:
        if self.index < 0:
            raise UserError(f"--index {self.index}: expected 0 or more")
        if self.attempt < 1:
            raise UserError(f"--attempt {self.attempt}: expected 1 or more")
        if self.retries < 0:
            raise UserError(f"--retries {self.retries}: expected 0 or more")
        _expect_limits(self.timeout_s, self.memory_gb, self.fetch_gb)


def _expect_limits(timeout_s: float | None, memory_gb: float | None, fetch_gb: float) -> None:
    if not 0 < fetch_gb < _MOST:
        raise UserError(f"--fetch-gb {fetch_gb:g}: expected GB, above 0")
    if timeout_s is not None and not timeout_s > 0:
        raise UserError(f"--timeout {timeout_s:g}: expected seconds, above 0")
    if memory_gb is not None and not 0 < memory_gb < _MOST:
        raise UserError(f"--memory {memory_gb:g}: expected GB, above 0")


@dataclass(frozen=True)
class StatusOptions:
    """Counts the logs of a batch that are done, failed and left; tells why each failed one did.

    Exit codes: 0 if all are done, 1 while some are left, else 3 if some failed, 2 if the input is bad.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {"out": "FOLDER"}

    out: str = "."
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""


@dataclass(frozen=True)
class RunOptions:
    """Runs all logs of a batch that are left, on this machine or on a Ray cluster.

    Each log is a run of hsslam-serve. One that crashes, or whose machine is lost, is tried again, a time-out
    once, bad input never. Ctrl-C lets running logs end; a second one ends them at once. The same command
    goes on with what is left.

    Exit codes: 0 if all logs are done, 1 while some are left, else 3 if some failed, 2 if the input is bad.

    Raises:
        UserError: a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {
        "out": "FOLDER",
        "scratch": "FOLDER",
        "metrics_file": "FILE",
        "address": "local|auto|HOST:PORT|ray://HOST:PORT",
    }
    ALIASES: ClassVar = {"timeout_s": "--timeout", "memory_gb": "--memory"}

    out: str = "."
    """Folder of the batch, which every machine of the cluster sees under this path, or URL as
    s3://BUCKET/BATCH."""
    address: str = "local"
    """The Ray cluster: one of its own on this machine, or one that is there."""
    cpus: float = 1.0
    """Cores that a log takes; with the memory it decides how many run at once."""
    memory_gb: float = 4.0
    """Memory that a log takes, GB; a run that takes more is ended."""
    timeout_s: float | None = None
    """Seconds that fetch and run of a log may take together (none: no limit)."""
    retries: int = 2
    """Attempts at a log after the first that failed."""
    scratch: Path | None = None
    """Folder of each node for logs that are fetched (none: .work in the batch)."""
    fetch_gb: float = 100.0
    """Largest log that is fetched, GB."""
    parallel: int | None = None
    """Run at most N logs at once (none: as many as fit)."""
    failed: bool = False
    """Try the logs that failed once more."""
    metrics_file: Path | None = None
    """File NAME.prom for the textfile collector of node_exporter, written every 15 s."""

    def __post_init__(self) -> None:
        if not 0 < self.cpus < _MOST:
            raise UserError(f"--cpus {self.cpus:g}: expected cores, above 0")
        if self.retries < 0:
            raise UserError(f"--retries {self.retries}: expected 0 or more")
        if self.metrics_file is not None and self.metrics_file.suffix != ".prom":
            raise UserError(
                f"--metrics-file {self.metrics_file}: expected a name that ends in .prom"
            )
        if self.metrics_file is not None and not self.metrics_file.absolute().parent.is_dir():
            raise UserError(
                f"--metrics-file {self.metrics_file}: no such folder: expected a file in one that exists"
            )
        if self.parallel is not None and self.parallel < 1:
            raise UserError(f"--parallel {self.parallel}: expected 1 or more")
        _expect_limits(self.timeout_s, self.memory_gb, self.fetch_gb)


@dataclass(frozen=True)
class ReportOptions:
    """Writes runs.parquet, a row a log, shows sums, costs and the worst logs; with --against what changed.

    A log got worse if its value grew by more than --noise, and by more than what is too small to matter,
    or if it has no value any more. Logs are compared by name.

    Exit codes: 0 if no log got worse, 1 if some did, 2 if the input is bad.

    Raises:
        UserError: a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {"out": "FOLDER", "against": "FOLDER", "plots": "FOLDER"}

    out: str = "."
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""
    against: str | None = None
    """Folder or URL of an earlier batch of the same logs."""
    noise: float = 0.2
    """Growth of a value that counts as noise, as a fraction."""
    worst: int = 10
    """Show at most N logs of each list."""
    plots: Path | None = None
    """Draw the figures of all logs, and what changed, into this folder (none: no pictures)."""

    def __post_init__(self) -> None:
        if not 0 <= self.noise < _MOST:
            raise UserError(f"--noise {self.noise:g}: expected a fraction, 0 or more")
        if self.worst < 1:
            raise UserError(f"--worst {self.worst}: expected 1 or more")
