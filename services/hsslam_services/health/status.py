"""The numbers of a run that the supervisor reports: the answer to `status`, and a part of the summary."""

import time
from collections.abc import Iterable, Mapping
from typing import Any, Literal

import msgspec

from hsslam_proto.request_messages import Status
from hsslam_services.bus.requests import RequestQueue
from hsslam_services.bus.subscription import Subscription
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.child import Child
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary, versions


def run_status(
    run: RunInfo,
    state: RunState,
    children: Mapping[str, Child],
    requests: RequestQueue,
    phase: Literal["running", "paused", "stopping"],
    memory_mb: int,
    rejected: int = 0,
) -> Status:
    """The answer to the request `status`; before the first pose, `phase` running becomes starting."""
    pose, now_s = state.pose, time.monotonic()
    tracking = state.tracking(now_s)
    is_starting = pose is None and phase == "running"
    return Status(
        run_id=run.run_id,
        state="starting" if is_starting else phase,
        source=run.options.source,
        preset=run.options.preset,
        pace=run.options.pace,
        seconds=now_s - state.started_s,
        frames_sent=frames_sent(children, state),
        frames_tracked=state.tracked,
        frames_lost=state.lost,
        frames_dropped=frames_dropped(children),
        fps=state.fps(now_s),
        latency_ms=state.latency_ms(now_s),
        tracking=tracking,
        quality=0.0 if pose is None or tracking == "none" else pose.quality,
        keyframes=state.last_keyframe + 1,
        map_version=state.map.version if state.map else 0,
        ba_rounds=state.ba_rounds,
        memory_mb=memory_mb,
        load_level=load_level(children),
        requests=requests.received,
        requests_refused=requests.refused,
        messages_rejected=rejected,
        processes={name: child.state for name, child in children.items()},
        restarts={name: child.restarts for name, child in children.items() if child.restarts},
    )


def process_section(
    run: RunInfo, children: Mapping[str, Child], state: RunState, stop_reason: str, end_s: float
) -> dict[str, Any]:
    """The supervisor's section of the summary: frames in, processes, stage times, options, versions.

    `end_s`: time of the stop, by the monotonic clock.
    """
    end = state.source_end
    if end is None:
        frames = {"dropped": frames_dropped(children)}
    else:
        known = read_summary(run.path).get("frames", {})  # from the pose log, by the saver
        answered = known.get("tracked", state.tracked) + known.get("lost", state.lost)
        frames = {
            "in": end.frame_count,
            "bad": end.bad_frame_count,
            "skipped": end.skipped_frame_count,
            "dropped": max(end.frame_count - answered, 0),
        }
    return {
        "run_id": run.run_id,
        "source": run.options.source,
        "stop_reason": stop_reason,
        "seed": run.options.seed,
        "seconds": end_s - state.started_s,
        "started_ns": run.started_ns,
        "frames": frames,
        "map": {
            "versions": state.map.version if state.map else 0,
            "iterations": state.map.iterations if state.map else 0,
        },
        "ba_rounds": state.ba_rounds,
        "processes": {name: _process(child) for name, child in children.items()},
        "options": msgspec.to_builtins(run.options),
        "versions": versions(),
    }


def _process(child: Child) -> dict[str, Any]:
    health = child.health
    return {
        "state": child.state,
        "restarts": child.restarts,
        "exit_code": child.exit_code,
        "peak_rss_bytes": child.peak_rss_bytes,
        "stage_ms": dict(health.stage_ms) if health else {},
        "counters": dict(health.counters) if health else {},
        "topics": msgspec.to_builtins(health.topics) if health else {},
    }


def frames_sent(children: Mapping[str, Child], state: RunState) -> int:
    """Frames sent, by the camera's last heartbeat or newer poses; 0 without a camera process."""
    if "camera" not in children:
        return 0
    return max(children["camera"].counted("sent"), state.tracked + state.lost)


def frames_dropped(children: Mapping[str, Child]) -> int:
    """Number of frames that the tracker missed or could not use in real time, also while it was restarted, or
    that the camera skipped because the source is slow."""
    missed = children["tracker"].counted("frames_dropped") if "tracker" in children else 0
    return missed + (children["camera"].counted("skipped") if "camera" in children else 0)


def load_level(children: Mapping[str, Child]) -> int:
    """The load level, by the tracker's last heartbeat."""
    health = children["tracker"].health if "tracker" in children else None
    return health.counters.get("load_level", 0) if health else 0


def rejected_messages(own: Iterable[Subscription], children: Mapping[str, Child]) -> dict[str, int]:
    """Number of rejected messages by topic, without zeros: the largest count of all receivers.

    All receivers of a topic reject the same messages; a restarted receiver counts from 0.
    """
    most = {subscription.topic.name: subscription.rejected for subscription in own}
    for child in children.values():
        for topic, counts in child.health.topics.items() if child.health else ():
            most[topic] = max(most.get(topic, 0), counts.rejected)
    return {topic: count for topic, count in sorted(most.items()) if count}
