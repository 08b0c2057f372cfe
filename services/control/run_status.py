"""The answer to `status`, from what the supervisor has heard."""

import time
from collections.abc import Mapping
from typing import Literal

from hsslam_node.proto.request_messages import Status
from hsslam_node.services.child import Child
from hsslam_node.services.request_queue import RequestQueue
from hsslam_node.services.run_info import RunInfo
from hsslam_node.services.run_state import RunState


def run_status(
    run: RunInfo,
    state: RunState,
    children: Mapping[str, Child],
    requests: RequestQueue,
    phase: Literal["running", "paused", "stopping"],
    memory_mb: int,
    rejected: int = 0,
) -> Status:
    """The run in numbers; `phase` is refined to starting before the first pose in a map."""
    pose = state.pose
    is_starting = pose is None and phase == "running"
    return Status(
        run_id=run.run_id,
        state="starting" if is_starting else phase,
        source=run.options.source,
        preset=run.options.preset,
        pace=run.options.pace,
        seconds=(time.time_ns() - run.started_ns) / 1e9,
        frames_sent=_sent(children, state),
        frames_tracked=state.tracked,
        frames_lost=state.lost,
        frames_dropped=_counter(children, "tracker", "dropped in/frame"),
        fps=state.fps,
        latency_ms=state.latency_ms,
        tracking="none" if pose is None else pose.status,
        quality=0.0 if pose is None else pose.quality,
        keyframes=state.last_keyframe + 1,
        map_version=state.map.version if state.map else 0,
        ba_rounds=state.ba_rounds,
        memory_mb=memory_mb,
        requests=requests.received,
        requests_refused=requests.refused,
        messages_rejected=rejected,
        processes={name: child.state for name, child in children.items()},
        restarts={name: child.restarts for name, child in children.items() if child.restarts},
    )


def _sent(children: Mapping[str, Child], state: RunState) -> int:
    """By the camera's last heartbeat, which is older than the last pose; 0 without a camera of ours."""
    if "camera" not in children:
        return 0
    return max(_counter(children, "camera", "sent"), state.tracked + state.lost)


def _counter(children: Mapping[str, Child], process: str, name: str) -> int:
    child = children.get(process)
    return child.health.counters.get(name, 0) if child and child.health else 0
