"""What the supervisor knows of a run at one moment, for threads that serve it."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from hsslam_node.proto.messages import Health
from hsslam_node.proto.request_messages import Status
from hsslam_node.services.child import Child
from hsslam_node.services.run_state import RunState


@dataclass(frozen=True)
class Snapshot:
    """`needed`: processes that the run cannot do without. `taken_s`: by the monotonic clock."""

    status: Status
    needed: frozenset[str]
    iterations: int
    latency_counts: tuple[int, ...]  # as `LatencyBins.cumulative`
    latency_sum_ms: float
    rejected: Mapping[str, int]  # by topic
    health: Mapping[str, Health]  # the last heartbeat of each process that lives
    taken_s: float


def take_snapshot(
    status: Status, rejected: Mapping[str, int], state: RunState, children: Mapping[str, Child]
) -> Snapshot:
    """Copies of everything that changes."""
    return Snapshot(
        status=status,
        needed=frozenset(
            name for name, child in children.items() if child.spec.is_needed(status.pace)
        ),
        iterations=state.map.iterations if state.map else 0,
        latency_counts=tuple(state.latency_bins.cumulative()),
        latency_sum_ms=state.latency_bins.sum_ms,
        rejected=dict(rejected),
        health={n: c.health for n, c in children.items() if c.health is not None and c.is_alive},
        taken_s=time.monotonic(),
    )
