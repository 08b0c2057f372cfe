"""One fault, what must happen then, and what an experiment has found; alone, as all experiments import it."""

from collections.abc import Callable
from dataclasses import dataclass

from hsslam_bench.faults.experiment import Experiment


@dataclass(frozen=True)
class Finding:
    """The end of an experiment: whether the service does what it must not, and what was seen."""

    is_shown: bool
    seen: str


class CouldNotTellError(Exception):
    """An experiment that shows neither; the text says why."""


@dataclass(frozen=True)
class Fault:
    """A row of the catalogue."""

    name: str
    happens: str
    must: str
    find: Callable[[Experiment], Finding]
    seconds: float  # that it takes on two cores
    needs_root: bool = False
    in_ci: bool = False  # short, and passes
