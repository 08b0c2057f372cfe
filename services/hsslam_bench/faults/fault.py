"""A fault, the behaviour that it must lead to, and a finding; alone, as all experiments import it."""

from collections.abc import Callable
from dataclasses import dataclass

from hsslam_bench.faults.experiment import Experiment


@dataclass(frozen=True)
class Finding:
    """The result of an experiment: whether the service showed the problem, and the figures."""

    is_shown: bool
    seen: str


class CouldNotTellError(Exception):
    """An experiment without a finding; the text gives the reason."""


@dataclass(frozen=True)
class Fault:
    """A row of the catalogue."""

    name: str
    happens: str
    must: str
    find: Callable[[Experiment], Finding]
    seconds: float  # duration on two cores
    needs_root: bool = False
    in_ci: bool = False  # short, and passes
