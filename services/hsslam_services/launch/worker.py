"""The common part of a run's processes: bus, arena, heartbeat, signals, death with the supervisor."""

import contextlib
import gc
import os
import signal
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Literal

import msgspec

from hsslam_node.sources.reports import Report
from hsslam_proto import topics
from hsslam_proto.run_messages import Event, Health, TopicCounts
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.publisher import Publisher
from hsslam_services.bus.subscription import Subscription
from hsslam_services.bus.zenoh_session import shared_memory_of_run
from hsslam_services.launch.heartbeat_figures import HeartbeatFigures
from hsslam_services.launch.process_table import process_number
from hsslam_services.run.camera_progress import CameraProgress
from hsslam_services.run.memory import OwnMemory, return_free_memory
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.run.resilient_stream import ResilientStream
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL

if TYPE_CHECKING:
    from hsslam_services.arena.arena import Arena

_HEARTBEAT_S = 0.5
FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.5, 10.0  # between tries
_POLL_S = 0.2  # of a pause
_TRIM_EVERY_S = 10.0
_EMA = 0.1  # weight of a new stage time
_REPORT_AGAIN = 10  # times as many rejected messages as in the last report


class Worker:
    """One process of a run, as a context manager: it sends heartbeats from entry to exit.

    The loop calls `ready` when it takes work, and `should_stop` in each turn, at least every few seconds:
    the supervisor's stall timeout watches these calls. Each heartbeat has `counters` and `stage_ms`.
    """

    def __init__(self, name: str, run: RunInfo) -> None:
        self.name = name
        self.run = run
        self.options = run.options
        first_camera = name == "camera" and not CameraProgress.exists(Path(run.arena_dir))
        shared_memory = shared_memory_of_run(
            run.options.has_camera_process, first_camera, process_number(name)
        )
        self.bus = Bus(run.endpoint, run.robot, name, settings=shared_memory)
        self.counters = HeartbeatFigures[int]()
        self.stage_ms = HeartbeatFigures[float]()
        self._state = "starting"
        self._stop = threading.Event()
        self._ended = threading.Event()
        self._loop_s = time.monotonic()
        self._report_rejected_at: dict[str, int] = {}  # by topic: next count to report
        self._memory = OwnMemory()
        self._log = ResilientStream(sys.stderr)
        self._result = ProcessResult()
        self._events = self.bus.publisher(topics.EVENT)
        self._health = self.bus.publisher(topics.HEALTH)
        self._last_health = self.bus.publisher(topics.HEALTH, block=True, follows_all=True)
        self._heartbeat = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> "Worker":
        signal.signal(END_SIGNAL, self._signalled)
        self._heartbeat.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._state = "stopping"
        self._ended.set()
        self._heartbeat.join()
        self.bus.close()
        self._log.drain()

    @cached_property
    def arena(self) -> "Arena":
        """The shared arrays of the run (imports torch)."""
        from hsslam_services.arena.arena import Arena

        return Arena(Path(self.run.arena_dir))

    def ready(self) -> None:
        """Announce that this process takes work; other processes wait for this."""
        gc.freeze()  # collections skip all objects so far
        self._state = "running"
        self._publish_health()

    def should_stop(self) -> bool:
        """Whether the loop must end: the supervisor has sent the signal, or is gone."""
        self._loop_s = time.monotonic()
        return self._stop.is_set()

    def is_orphan(self) -> bool:
        """Whether the supervisor is gone."""
        return os.getppid() != self.run.supervisor_pid

    def stop_event(self) -> threading.Event:
        """The event that is set when the loop must end; wait on it instead of sleeping."""
        return self._stop

    def pause(self, seconds: float) -> None:
        """Wait for `seconds` or until the worker must stop; counts as turns of the loop."""
        left_s = seconds
        while left_s > 0 and not self.should_stop():
            self._stop.wait(min(_POLL_S, left_s))
            left_s -= _POLL_S

    def tries(self) -> Iterator[None]:
        """Yield once for each try, with growing pauses between, until the worker must stop."""
        pause_s = FIRST_PAUSE_S
        while not self.should_stop():
            yield
            self.pause(pause_s)
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter of the heartbeat."""
        self.counters.add(name, by)

    @contextlib.contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Time a block; the heartbeat has its running mean (ms)."""
        start = time.perf_counter()
        yield
        took_ms = 1e3 * (time.perf_counter() - start)
        mean_ms = self.stage_ms.get(stage, took_ms)
        self.stage_ms[stage] = mean_ms + _EMA * (took_ms - mean_ms)

    def event(self, level: Literal["info", "warning", "error"], text: str) -> None:
        """Report to the operator: status line, log, viewer. A disk that is full or hangs costs only the line
        in the log."""
        self._log.write(f"{level}: {text}\n")
        self._events.put(Event.now(self.name, level, text))

    def warn_once(self, report: Report) -> None:
        """Count a report by its kind; send a warning for the first of each kind."""
        if self.counters.add(report.kind, 1) == 1:
            self.event("warning", f"{report.text} (further ones are counted)")

    def add_to_summary(self, section: Mapping[str, Any]) -> None:
        """Add a section of summary.json to this process's result, for the supervisor."""
        sections = {**self._result.summary, **section}
        self._save_result(msgspec.structs.replace(self._result, summary=sections))

    def answer(self, answer: msgspec.Struct) -> None:
        """Add the answer to the request that started this process to its result."""
        self._save_result(msgspec.structs.replace(self._result, answer=msgspec.to_builtins(answer)))

    def _save_result(self, result: ProcessResult) -> None:
        self._result = result
        try:
            write_result(self.run.path, self.name, result)
        except OSError as error:
            text = f"{self.run.path}: {error.strerror}: result of {self.name} not saved"
            self.event("error", text)

    def _signalled(self, _number: int, _frame: FrameType | None) -> None:
        """Handle only the first signal: a second one during `set` would deadlock on its lock."""
        signal.signal(END_SIGNAL, signal.SIG_IGN)
        self._stop.set()

    def _beat(self) -> None:
        trim_at_s = 0.0
        while True:
            self._publish_health()
            if time.monotonic() >= trim_at_s:
                return_free_memory()
                trim_at_s = time.monotonic() + _TRIM_EVERY_S
            if self._ended.wait(_HEARTBEAT_S):
                break
            if self.is_orphan():
                self._stop.set()
        self._publish_health(self._last_health)  # the recorder waits for it: no message follows it

    def _publish_health(self, publisher: Publisher[Health] | None = None) -> None:
        state = self._state  # read before the counters, so that "running" comes with them
        counters = self.counters.copy()
        counts: dict[str, TopicCounts] = {}
        for subscription in self.bus.subscriptions:
            counts[subscription.topic.name] = TopicCounts(
                dropped=subscription.dropped,
                rejected=subscription.rejected,
                received=subscription.received,
            )
            self._report_rejected(subscription)
        (publisher or self._health).put(
            Health(
                process=self.name,
                pid=os.getpid(),
                state=state,
                rss_bytes=_rss_bytes(),
                pss_mb=self._memory.pss_mb(),
                idle_ms=int(1e3 * (time.monotonic() - self._loop_s)),
                topics=counts,
                counters=counters,
                stage_ms=self.stage_ms.copy(),
            )
        )

    def _report_rejected(self, subscription: Subscription) -> None:
        """Report the first rejected message of a topic, and again at each tenfold count."""
        count, topic = subscription.rejected, subscription.topic.name
        rejections = subscription.take_rejections()
        if rejections and count >= self._report_rejected_at.get(topic, 1):
            self._report_rejected_at[topic] = _REPORT_AGAIN * count
            so_far = f" ({count} so far)" if count > 1 else ""
            self.event("warning", f"dropped: {rejections[0].text}{so_far}")


def _rss_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
