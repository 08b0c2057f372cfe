"""A snapshot as the supervisor takes it."""

import dataclasses
from typing import Any

import msgspec

from hsslam_proto.request_messages import Status
from hsslam_proto.run_messages import Health, TopicCounts
from hsslam_services.health.run_state import LatencyBins
from hsslam_services.health.snapshot import Snapshot
from hsslam_services.launch.process_table import PROCESSES

LATENCIES_MS = (4.0, 5.0, 12.0, 2000.0)


def snapshot(processes: dict[str, str] | None = None, **status: Any) -> Snapshot:
    """All processes run but those named, with these fields of the status changed."""
    bins = LatencyBins()
    for latency_ms in LATENCIES_MS:
        bins.add(latency_ms)
    states = {spec.name: "running" for spec in PROCESSES} | (processes or {})
    return Snapshot(
        status=msgspec.structs.replace(_STATUS, processes=states, **status),
        needed=frozenset({"tracker", "mapper"}),
        iterations=420,
        latency_counts=tuple(bins.cumulative()),
        latency_sum_ms=bins.sum_ms,
        rejected={"in/frame": 3},
        health={"tracker": _TRACKER},
        taken_s=100.0,
    )


def taken_at(taken_s: float) -> Snapshot:
    """One of this time."""
    return dataclasses.replace(snapshot(), taken_s=taken_s)


_TRACKER = Health(
    process="tracker",
    pid=7,
    state="running",
    rss_bytes=10**9,
    pss_mb=250,
    topics={"in/frame": TopicCounts(dropped=2, rejected=3)},
    stage_ms={"align": 8.0},
)
_STATUS = Status(
    run_id="run-1",
    state="running",
    source='tum:a "quoted" name',
    preset="realtime",
    pace="realtime",
    seconds=12.5,
    frames_sent=100,
    frames_tracked=96,
    frames_lost=2,
    frames_dropped=2,
    fps=29.9,
    latency_ms=13.0,
    tracking="tracked",
    quality=0.97,
    keyframes=9,
    map_version=31,
    ba_rounds=4,
    memory_mb=900,
    requests=5,
    requests_refused=1,
    messages_rejected=3,
    processes={},
    restarts={"mapper": 1},
)
