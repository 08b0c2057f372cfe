"""Converts a snapshot of a run to Prometheus metrics."""

from collections.abc import Iterator

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
    StateSetMetricFamily,
)
from prometheus_client.exposition import choose_encoder

from hsslam_node import __version__
from hsslam_services.health.metrics_registry import registry_of
from hsslam_services.health.run_state import BOUNDS_MS
from hsslam_services.health.snapshot import Snapshot

_STATES = ("starting", "running", "paused", "stopping")


def exposition(snapshot: Snapshot | None, accept: str = "") -> tuple[bytes, str]:
    """Body and content type of the response, in the format of the header `Accept`."""
    metrics = [] if snapshot is None else [*_of_run(snapshot), *_of_processes(snapshot)]
    encode, content_type = choose_encoder(accept)
    return encode(registry_of(metrics)), content_type


def _of_run(snapshot: Snapshot) -> Iterator[Metric]:
    run = snapshot.status
    labels = {"run_id": run.run_id, "source": run.source, "preset": run.preset, "pace": run.pace}
    yield InfoMetricFamily("hsslam_run", "The run", labels | {"version": __version__})
    states = {name: name == run.state for name in _STATES}
    yield StateSetMetricFamily("hsslam_state", "State of the run", states)
    yield _gauge("uptime_seconds", "Seconds since the start of the run", run.seconds)
    yield _counter("frames_sent", "Frames that the camera process sent", run.frames_sent)
    yield _counter("frames_tracked", "Frames with a pose", run.frames_tracked)
    yield _counter("frames_lost", "Frames whose pose is not trusted", run.frames_lost)
    yield _counter("frames_dropped", "Frames that were not tracked in time", run.frames_dropped)
    yield _gauge("pose_rate_hertz", "Poses per second over the last seconds", run.fps)
    text = "Seconds in which frames came without a pose"
    yield _gauge("silence_seconds", text, snapshot.silent_s)
    text = "Seconds in which the disk of the run folder did not answer"
    yield _gauge("disk_silence_seconds", text, snapshot.disk_silent_s)
    if (age_s := snapshot.pose_age_s) is not None:
        yield _gauge("pose_age_seconds", "Seconds since the last pose", age_s)
    buckets = [str(bound / 1e3) for bound in BOUNDS_MS] + ["+Inf"]
    yield HistogramMetricFamily(
        "hsslam_latency_seconds",
        "From the sensor's stamp to the published pose",
        buckets=list(zip(buckets, snapshot.latency_counts, strict=True)),
        sum_value=snapshot.latency_sum_ms / 1e3,
    )
    yield _gauge("tracking_quality", "Share of depth within 2 cm of the map, 0 to 1", run.quality)
    yield _gauge("load_level", "Load level; 0: all work is done", run.load_level)
    yield _gauge("keyframes", "Keyframes", run.keyframes)
    yield _gauge("map_version", "Version of the map", run.map_version)
    yield _counter("resets", "Resets of the map", run.map_epoch)
    yield _counter("map_iterations", "Mapping iterations", snapshot.iterations)
    yield _counter("ba_rounds", "Rounds of global bundle adjustment", run.ba_rounds)
    yield _gauge("memory_bytes", "Memory of all processes (PSS)", 1e6 * run.memory_mb)
    yield _counter("requests", "Received requests", run.requests)
    yield _counter("requests_refused", "Refused requests", run.requests_refused)
    if (days := snapshot.certificate_days) is not None:
        yield _gauge(
            "certificate_valid_days", "Days until the certificate of --security expires", days
        )
    rejected = CounterMetricFamily(
        "hsslam_messages_rejected", "Messages that could not be read", labels=["topic"]
    )
    for topic, count in snapshot.rejected.items():
        rejected.add_metric([topic], count)
    yield rejected


def _of_processes(snapshot: Snapshot) -> Iterator[Metric]:
    run = snapshot.status
    up = GaugeMetricFamily("hsslam_process_up", "1: the process runs", labels=["process"])
    restarts = CounterMetricFamily("hsslam_process_restarts", "Restarts", labels=["process"])
    for name, state in run.processes.items():
        up.add_metric([name], float(state == "running"))
        restarts.add_metric([name], run.restarts.get(name, 0))
    memory = GaugeMetricFamily("hsslam_process_memory_bytes", "PSS", labels=["process"])
    stages = GaugeMetricFamily(
        "hsslam_stage_seconds", "Running mean of the time of a stage", labels=["process", "stage"]
    )
    dropped = CounterMetricFamily(
        "hsslam_messages_dropped", "Messages that a process missed", labels=["process", "topic"]
    )
    for name, health in snapshot.health.items():
        memory.add_metric([name], 1e6 * health.pss_mb)
        for stage, took_ms in health.stage_ms.items():
            stages.add_metric([name, stage], took_ms / 1e3)
        for topic, counts in health.topics.items():
            dropped.add_metric([name, topic], counts.dropped)
    yield from (up, restarts, memory, stages, dropped)


def _gauge(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(f"hsslam_{name}", text, value)


def _counter(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(f"hsslam_{name}", text, value)
