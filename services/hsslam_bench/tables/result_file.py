"""The JSON file with the results of a table; several commands may add runs to one file."""

import fcntl
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import msgspec

from hsslam_bench.results.report import Machine
from hsslam_bench.tables.plan import Job, RunResult
from hsslam_node.errors import UserError
from hsslam_services.run.run_info import write_atomically
from hsslam_services.run.summary import names_code

VERSION = 1


class _Content(msgspec.Struct):
    table: str
    machine: Machine | None = None  # of the last run
    runs: list[RunResult] = []
    version: int = VERSION


class ResultFile:
    """All runs of one table; each write replaces the file in one step.

    Raises:
        UserError: the file exists but is not a result of this table.
    """

    def __init__(self, path: Path, table: str) -> None:
        self._path = path
        self._table = table
        self._content()

    @property
    def runs(self) -> Sequence[RunResult]:
        """The runs in the file now, oldest first."""
        return self._content().runs

    def done(self, job: Job, commit: str) -> RunResult | None:
        """The result of exactly this job and commit, unless it failed; None without one.

        None also if the commit does not name the code.
        """
        if not names_code(commit):
            return None
        same = [r for r in self.runs if (r.key, r.commit) == (job.key, commit) and not r.error]
        return same[-1] if same else None

    def newest(self, job: Job) -> RunResult | None:
        """The last result of the job's row, sequence, seed and protocol, from any commit."""
        found = [result for result in self.runs if result.answers(job)]
        return found[-1] if found else None

    def add(self, result: RunResult, machine: Machine) -> None:
        """Store a result; it replaces an older result of the same key and commit."""
        with self._locked():
            content = self._content()
            content.runs = [
                r for r in content.runs if (r.key, r.commit) != (result.key, result.commit)
            ]
            content.runs.append(result)
            content.machine = machine
            try:
                write_atomically(self._path, msgspec.json.format(msgspec.json.encode(content)))
            except OSError as error:
                raise self._not_writable(error) from None

    @contextmanager
    def _locked(self) -> Iterator[None]:
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            lock = self._path.with_name(f".{self._path.name}.lock").open("w")
        except OSError as error:
            raise self._not_writable(error) from None
        with lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            yield

    def _content(self) -> _Content:
        if not self._path.exists():
            return _Content(self._table)
        expected = f"expected a result of hsslam-bench {self._table}"
        try:
            content = msgspec.json.decode(self._path.read_bytes(), type=_Content)
        except OSError as error:
            raise UserError(f"--out {self._path}: {error.strerror}: {expected}") from None
        except msgspec.MsgspecError as error:
            raise UserError(f"--out {self._path}: {error}: {expected}") from None
        if (content.table, content.version) != (self._table, VERSION):
            found = f"holds {content.table}, version {content.version}"
            raise UserError(f"--out {self._path}: {found}: {expected}, version {VERSION}")
        return content

    def _not_writable(self, error: OSError) -> UserError:
        return UserError(f"--out {self._path}: {error.strerror}: expected a file to write")
