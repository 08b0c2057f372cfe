"""One run of a table: what is run, and what came out."""

import hashlib
from typing import Any, Literal

import msgspec

from hsslam_node.config import SlamConfig
from hsslam_node.services.bench.tables.paper_tables import TableName
from hsslam_node.sources.source import SourceOptions


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """One configuration on one sequence with one seed, complete: a process needs nothing else."""

    table: TableName
    row: str
    sequence: str
    source: str  # as for --source
    seed: int
    protocol: str  # in words; preset and changes to it are in the configuration
    config: SlamConfig
    frames: SourceOptions
    device: Literal["auto", "cpu", "cuda"] = "cpu"

    @property
    def name(self) -> str:
        """For people and for the run's folder."""
        return f"{self.row}-{self.sequence.replace('/', '-')}-seed{self.seed}"

    @property
    def key(self) -> str:
        """Equal for jobs that do the same; where the data lies is no matter."""
        same = msgspec.structs.replace(self, source=self.source.rpartition("/")[2])
        return hashlib.sha256(msgspec.json.encode(same)).hexdigest()[:16]


class RunResult(msgspec.Struct, frozen=True, kw_only=True):
    """What came out of a job. New fields have defaults."""

    key: str
    row: str
    sequence: str
    seed: int
    protocol: str
    commit: str  # ends with + where files had been changed
    time: str = ""  # UTC
    values: dict[str, float | None] = {}  # by metric
    details: dict[str, Any] = {}  # the evaluation's report, the model's parts, frames
    error: str = ""  # its last words if it failed
    scored_by: str = ""  # commit of a later evaluation of the same trajectories and mesh

    def answers(self, job: Job) -> bool:
        """Whether this is of the job's row, sequence, seed and protocol, be it of another commit."""
        mine = (self.row, self.sequence, self.seed, self.protocol)
        return mine == (job.row, job.sequence, job.seed, job.protocol)
