"""Whether a run is healthy: the answer to `/healthz`."""

import time
from typing import Any

from hsslam_node.services.metrics.snapshot import Snapshot

_HUNG_S = 10.0  # the supervisor comes round every 50 ms
_CAMERA = "camera"


def health_of(snapshot: Snapshot | None, now_s: float | None = None) -> tuple[int, dict[str, Any]]:
    """Status code of HTTP and body. 200: all needed processes run, or the run ends in order; else 503.

    `status` in the body: ok, paused, degraded (runs without one that it can do without), stopping;
    starting, down, hung.
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
    }
    return 503 if body["status"] in ("starting", "down", "hung") else 200, body


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
    if run.state == "paused":
        return "paused"
    return "degraded" if missing else "ok"
