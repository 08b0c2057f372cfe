"""Rows of a full service on a weaker machine: 60 % of two cores, and kernels without AVX-512."""

from collections.abc import Callable
from dataclasses import dataclass

from hsslam_bench.checks import live_figures
from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.sequences import RECORDED_ROOM
from hsslam_bench.runs.serve_run import ServeRun, finished
from hsslam_bench.runs.session import Session

_SEQUENCES = {
    "kitchen": "kitchen",
    RECORDED_ROOM: "a recording of room in PNG",
    "room": "room",
}
_TRACKED, _P99_MS, _ATE_FACTOR = 0.99, 80.0, 1.5


@dataclass(frozen=True)
class _Kind:
    """A kind of weaker machine, and the sequences that run on it."""

    name: str
    what: str
    make: Callable[[Session, str], ServeRun]
    sequences: tuple[str, ...]


_KINDS = (
    _Kind("quota", "60 % of two cores", Session.quota, tuple(_SEQUENCES)),
    _Kind("avx2", "no AVX-512", Session.avx2, ("kitchen", "room")),
)


def quota_checks() -> list[Check]:
    """One row for each kind, sequence and figure."""
    return [
        check for kind in _KINDS for sequence in kind.sequences for check in _checks(kind, sequence)
    ]


def _checks(kind: _Kind, sequence: str) -> list[Check]:
    def tracked(session: Session) -> Measured:
        return live_figures.tracked(finished(kind.make(session, sequence)), _TRACKED)

    def latency(session: Session) -> Measured:
        return live_figures.latency(finished(kind.make(session, sequence)), "p99", _P99_MS)

    def accuracy(session: Session) -> Measured:
        run = finished(kind.make(session, sequence))
        return live_figures.accuracy(run, finished(session.lockstep(sequence)), _ATE_FACTOR)

    def levels(session: Session) -> Measured:
        run = finished(kind.make(session, sequence))
        counters = run.summary["processes"]["tracker"]["counters"]
        found = {k: n for k, n in sorted(counters.items()) if "load level" in k}
        return Measured(", ".join(f"{key}: {n}" for key, n in found.items()), None, found)

    row = f"{kind.name}:{sequence}"
    of = f"{_SEQUENCES[sequence]}, 30 Hz, a viewer attached, {kind.what}"
    return [
        Check(
            f"{row}:tracked", f"{of}: frames tracked after the first", f"{_TRACKED:.0%}", tracked
        ),
        Check(f"{row}:latency", f"{of}: latency to published pose", f"p99 {_P99_MS:g} ms", latency),
        Check(f"{row}:ate", f"{of}: ATE RMSE, seed 0", f"{_ATE_FACTOR:g} x lockstep", accuracy),
        Check(f"{row}:levels", f"{of}: frames at each load level", "", levels),
    ]
