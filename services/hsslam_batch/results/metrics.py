"""The counts of a batch as metrics of Prometheus, in a file for the textfile collector of node_exporter."""

import time
from collections.abc import Iterator
from pathlib import Path

from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import generate_latest

from hsslam_batch.plan.batch import BatchFile
from hsslam_batch.results.tally import Tally
from hsslam_node.durable_file import write_durably
from hsslam_services.health.metrics_registry import registry_of

_EVERY_S = 15.0


class MetricsFile:
    """Writes the file every 15 s; writes nothing if `path` is None."""

    def __init__(self, path: Path | None, about: BatchFile) -> None:
        self._path = path
        self._about = about
        self._due_s = 0.0

    def tick(self, tally: Tally, running: int) -> None:
        """Write the file if 15 s have passed; `running`: number of running logs.

        Raises:
            OSError: the file is not writable.
        """
        if time.monotonic() >= self._due_s:
            self.write(tally, running)

    def write(self, tally: Tally, running: int) -> None:
        """Write the file in one step.

        Raises:
            OSError: the file is not writable.
        """
        if self._path is None:
            return
        self._due_s = time.monotonic() + _EVERY_S
        registry = registry_of(list(_metrics(self._about, tally, running)))
        write_durably(self._path, generate_latest(registry))


def _metrics(about: BatchFile, tally: Tally, running: int) -> Iterator[Metric]:
    labels = {"configuration": about.configuration, "code": about.code, "logs": about.logs}
    yield InfoMetricFamily("hsslam_batch", "Configuration, code and logs", labels)
    logs = GaugeMetricFamily("hsslam_batch_logs", "Logs by state", labels=["state"])
    states = {"done": tally.done, "failed": tally.failed, "left": tally.left}
    for state, count in states.items():
        logs.add_metric([state], count)
    yield logs
    text = "Running logs, among those that are left"
    yield GaugeMetricFamily("hsslam_batch_logs_running", text, running)
    text = "Failed attempts that were tried again, since the start of this command"
    yield CounterMetricFamily("hsslam_batch_attempts_repeated", text, tally.tried_again)
    if tally.frames is not None:
        yield GaugeMetricFamily("hsslam_batch_frames", "Frames of all logs", tally.frames)
    text = "Frames of logs that are done or failed, and frames of running logs so far"
    yield GaugeMetricFamily("hsslam_batch_frames_done", text, tally.frames_done)
    text = "Core time of logs that ended since the start of this command"
    yield CounterMetricFamily("hsslam_batch_core_seconds", text, tally.core_s)
    if (rest_s := tally.rest_s()) is not None:
        yield GaugeMetricFamily("hsslam_batch_rest_seconds", "Time until all logs end", rest_s)
    text = "Time of the last write; a batch that has ended or died stops writing"
    yield GaugeMetricFamily("hsslam_batch_written_timestamp_seconds", text, time.time())
