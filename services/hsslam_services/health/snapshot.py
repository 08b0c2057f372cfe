"""A snapshot of a run's state for the HTTP threads, and the answer to `/healthz`."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hsslam_proto.request_messages import Status
from hsslam_proto.run_messages import Health
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.child import Child

_HUNG_S = 10.0  # the supervisor's loop takes 50 ms
_SILENT_S = 5.0  # frames without a pose, or a disk without an answer
_CAMERA = "camera"


@dataclass(frozen=True)
class Snapshot:
    """State of a run. `needed`: processes that the run needs. `taken_s`: monotonic clock."""

    status: Status
    needed: frozenset[str]
    iterations: int
    latency_counts: tuple[int, ...]  # as `LatencyBins.cumulative`
    latency_sum_ms: float
    rejected: Mapping[str, int]  # by topic
    health: Mapping[str, Health]  # last heartbeat of each living process
    taken_s: float
    silent_s: float = 0.0  # how long frames have come without a pose
    pose_age_s: float | None = None  # since the last pose; None before the first
    certificate_days: float | None = None  # until it expires; None without `security`
    disk_silent_s: float = 0.0  # how long the disk of the run folder has not answered


def take_snapshot(
    status: Status,
    rejected: Mapping[str, int],
    state: RunState,
    children: Mapping[str, Child],
    certificate_days: float | None = None,
    disk_silent_s: float = 0.0,
) -> Snapshot:
    """Take a snapshot: copies of all data that changes."""
    now_s = time.monotonic()
    return Snapshot(
        status=status,
        needed=frozenset(
            name for name, child in children.items() if child.spec.is_needed(status.pace)
        ),
        iterations=state.map.iterations if state.map else 0,
        latency_counts=tuple(state.latency_bins.cumulative()),
        latency_sum_ms=state.latency_bins.sum_ms,
        rejected=dict(rejected),
        certificate_days=certificate_days,
        disk_silent_s=disk_silent_s,
        health={n: c.health for n, c in children.items() if c.health is not None and c.is_alive},
        taken_s=now_s,
        silent_s=0.0 if status.state == "stopping" else state.silence.seconds(now_s),
        pose_age_s=state.pose_age_s(now_s),
    )


def health_of(snapshot: Snapshot | None, now_s: float | None = None) -> tuple[int, dict[str, Any]]:
    """HTTP status code and body. 200: all needed processes run, or the run is stopping; else 503.

    `status` in the body: ok, paused, degraded (a process that is not needed is missing, or the disk of the
    run folder has not answered for 5 s), stopping; starting, down, hung, silent (frames, but no pose for
    5 s). A camera that sends nothing is no fault of the service: `pose_age_s` and `tracking` tell it.
    """
    if snapshot is None:
        return 503, {"status": "starting"}
    run = snapshot.status
    age_s = (time.monotonic() if now_s is None else now_s) - snapshot.taken_s
    missing = {name: state for name, state in run.processes.items() if state != "running"}
    if missing.get(_CAMERA) == "ended":  # the source has ended
        del missing[_CAMERA]
    body = {
        "status": _word(snapshot, missing, age_s),
        "not_running": missing,
        "run_id": run.run_id,
        "seconds": round(run.seconds, 1),
        "tracking": run.tracking,
        "fps": round(run.fps, 1),
        "silent_s": round(snapshot.silent_s, 1),
        "disk_silent_s": round(snapshot.disk_silent_s, 1),
        "pose_age_s": None if snapshot.pose_age_s is None else round(snapshot.pose_age_s, 1),
    }
    return 503 if body["status"] in ("starting", "down", "hung", "silent") else 200, body


def _word(snapshot: Snapshot, missing: dict[str, str], age_s: float) -> str:
    run = snapshot.status
    if age_s > _HUNG_S:
        return "hung"
    if run.state == "stopping":
        return "stopping"
    needed = [missing[name] for name in missing if name in snapshot.needed or name == _CAMERA]
    if needed:
        never_ran = not run.restarts and all(state in ("waiting", "starting") for state in needed)
        return "starting" if never_ran and run.state == "starting" else "down"
    if snapshot.silent_s > _SILENT_S:
        return "silent"
    if run.state == "paused":
        return "paused"
    return "degraded" if missing or snapshot.disk_silent_s > _SILENT_S else "ok"
