"""The options of `hsslam-batch`: one frozen dataclass a subcommand."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from hsslam_node.errors import UserError

_MOST = 1e6  # cores, GB, ratio, s of patience
_LEAST_CPUS = 1e-4  # Ray counts no smaller parts of a core


@dataclass(frozen=True)
class PlanOptions:
    """Lists the logs below a folder and fixes the options of their runs; runs nothing.

    Accepts the options of hsslam-serve, as --preset paper or --config FILE. Runs use --pace lockstep and
    --viewer none.

    Examples:
      hsslam-batch plan recordings --out tonight --seed 1
      hsslam-batch run tonight

    Planning a folder again keeps the logs that are done with the same options and code.
    """

    POSITIONALS: ClassVar = ("logs",)
    VALUES: ClassVar = {"logs": "FOLDER", "out": "FOLDER"}

    logs: str = ""
    """Folder with logs and sequences at any depth, or URL as s3://BUCKET/LOGS."""
    out: str = ""
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""


@dataclass(frozen=True)
class WorkOptions:
    """Runs one log without Ray, for schedulers that start a task for each index.

    Exit codes: 0 if the log is done, 1 if the command is interrupted, 2 if the log or an option is bad, 3 if
    the run fails for another reason.

    Raises:
        UserError: a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {"out": "FOLDER", "id": "ID", "scratch": "FOLDER"}
    ALIASES: ClassVar = {
        "timeout_s": "--timeout",
        "memory_gb": "--memory",
        "patience_s": "--patience",
    }

    out: str = "."
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""
    index: int = 0
    """Row of the log in the manifest, from 0."""
    id: str = ""
    """Id that the log must have, else the command refuses it (empty: any)."""
    attempt: int = 1
    """Number of this attempt at the log."""
    retries: int = 0
    """Attempts allowed after the first; the next attempt resumes a failed fetch."""
    timeout_s: float | None = None
    """Time limit for download and run of the log together, s (none: no limit)."""
    memory_gb: float | None = None
    """Most memory of all processes of the run together, GB (none: no limit)."""
    scratch: Path | None = None
    """Folder for fetched logs (none: .work in the batch)."""
    fetch_gb: float = 100.0
    """Largest log to fetch, GB."""
    patience_s: float = 300.0
    """How long an attempt waits for a store that fails, s."""
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
        _expect_limits(self.timeout_s, self.memory_gb, self.fetch_gb, self.patience_s)


def _expect_limits(
    timeout_s: float | None, memory_gb: float | None, fetch_gb: float, patience_s: float
) -> None:
    if not 0 <= patience_s < _MOST:
        raise UserError(f"--patience {patience_s:g}: expected seconds, 0 or more")
    if not 0 < fetch_gb < _MOST:
        raise UserError(f"--fetch-gb {fetch_gb:g}: expected GB, above 0")
    if timeout_s is not None and not timeout_s > 0:
        raise UserError(f"--timeout {timeout_s:g}: expected seconds, above 0")
    if memory_gb is not None and not 0 < memory_gb < _MOST:
        raise UserError(f"--memory {memory_gb:g}: expected GB, above 0")


@dataclass(frozen=True)
class StatusOptions:
    """Counts the logs of a batch that are done, failed and left; shows why each failed log failed.

    Exit codes: 0 if all are done, 1 while some are left, else 3 if some failed, 2 if the input is bad.
    """

    POSITIONALS: ClassVar = ("out",)
    VALUES: ClassVar = {"out": "FOLDER"}

    out: str = "."
    """Folder of the batch, or URL as s3://BUCKET/BATCH."""


@dataclass(frozen=True)
class RunOptions:
    """Runs all logs of a batch that are left, on this machine or on a Ray cluster.

    Each log is a run of hsslam-serve. The command tries a log again after a crash or a lost machine, once
    after a time-out, never after bad input or if the run used more than --memory. Ctrl-C lets running logs
    finish; a second Ctrl-C stops them now. The same command resumes the batch.

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
    ALIASES: ClassVar = {
        "timeout_s": "--timeout",
        "memory_gb": "--memory",
        "patience_s": "--patience",
    }

    out: str = "."
    """Folder of the batch (the same path on every machine of a cluster), or URL as s3://BUCKET/BATCH."""
    address: str = "local"
    """The Ray cluster: a new one on this machine (local), or a running one."""
    cpus: float = 1.0
    """Cores for each log; cores and memory decide how many logs run at once."""
    memory_gb: float = 4.0
    """Memory for each log, GB; a run that uses more is stopped."""
    timeout_s: float | None = None
    """Time limit for download and run of a log together, s (none: no limit)."""
    retries: int = 2
    """Largest number of attempts at a log after the first."""
    scratch: Path | None = None
    """Folder for fetched logs on each node (none: .work in the batch)."""
    fetch_gb: float = 100.0
    """Largest log to fetch, GB."""
    patience_s: float = 300.0
    """How long an attempt waits for a store that fails, s."""
    parallel: int | None = None
    """Run at most N logs at once (none: as many as fit)."""
    failed: bool = False
    """Try the failed logs again."""
    metrics_file: Path | None = None
    """File NAME.prom for the textfile collector of node_exporter, written every 15 s."""

    def __post_init__(self) -> None:
        if not _LEAST_CPUS <= self.cpus < _MOST:
            raise UserError(f"--cpus {self.cpus:g}: expected cores, {_LEAST_CPUS:g} or more")
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
        _expect_limits(self.timeout_s, self.memory_gb, self.fetch_gb, self.patience_s)


@dataclass(frozen=True)
class ReportOptions:
    """Writes runs.parquet, a row a log; shows sums, costs, and the worst logs or, with --against, changes.

    A log got worse if a value grew by more than --noise and by more than a minimum (ATE 0.5 mm, mesh accuracy
    1 mm, 1 % of the true mesh missing, 1 lost frame, 5 s of core time, 100 MB), or if the value is missing
    now. Logs are compared by name.

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
    """Relative growth of a value that counts as noise."""
    worst: int = 10
    """Show at most N logs of each list."""
    plots: Path | None = None
    """Folder for plots of all logs and of what changed (none: no plots)."""

    def __post_init__(self) -> None:
        if not 0 <= self.noise < _MOST:
            raise UserError(f"--noise {self.noise:g}: expected a fraction, 0 or more")
        if self.worst < 1:
            raise UserError(f"--worst {self.worst}: expected 1 or more")
