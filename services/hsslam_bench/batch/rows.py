"""What `hsslam-batch` itself costs: time of a slot and core time for each log, memory of its driver."""

import importlib.util
import json
from typing import Any

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.runs.session import NotMeasured, Session

_SLOT_MS, _GROWTH = 50.0, 0.05
_MODULE = "hsslam_bench.batch.scheduling"


def batch_checks() -> list[Check]:
    """One row for the time, one for the memory."""
    of = "2000 logs of one frame, whose runs take no time, as tasks of Ray on this machine"
    return [
        Check(
            "batch:scheduling",
            f"{of}: time that a log holds its slot",
            f"{_SLOT_MS:g} ms",
            _scheduling,
            by_name_only=True,
        ),
        Check(
            "batch:memory",
            f"{of}: memory of the driver, after a tenth of the logs and at the end",
            f"+ {_GROWTH:.0%}",
            _memory,
            by_name_only=True,
        ),
    ]


def _scheduling(session: Session) -> Measured:
    found = _found(session)
    slot_ms = found["slot_ms"]
    return Measured(
        f"{slot_ms:.1f} ms, {found['slots']} slots; core time {found['driver_ms']:.1f} ms of the driver, "
        f"{found['ray_ms']:.1f} ms of Ray and the commands; {found['done']} of {found['logs']} logs",
        slot_ms <= _SLOT_MS and found["done"] == found["logs"],
        found,
        slot_ms,
        "lower",
    )


def _memory(session: Session) -> Measured:
    found = _found(session)
    before_mb, after_mb = found["memory_mb"], found["last_memory_mb"]
    growth = after_mb / before_mb - 1
    return Measured(
        f"{before_mb:.1f} MB, {after_mb:.1f} MB ({growth:+.1%})",
        growth <= _GROWTH,
        found,
        growth,
        "lower",
    )


def _found(session: Session) -> dict[str, Any]:
    if importlib.util.find_spec("ray") is None:
        raise NotMeasured("package ray is missing: pip install 'hsslam-node[batch]'")
    return json.loads(session.python(_MODULE))
