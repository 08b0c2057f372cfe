"""The processes of a prepared run, kept running and stopped in order, and what is heard from them."""

import time
from collections.abc import Callable

from hsslam_node.device.torch_build import cuda_torch_without_cuda
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import warm_stamp
from hsslam_proto import topics
from hsslam_proto.messages import Event, Stop
from hsslam_services.bus.bus import Bus
from hsslam_services.health.run_state import Listener
from hsslam_services.health.snapshot import take_snapshot
from hsslam_services.health.status import frames_dropped, process_section
from hsslam_services.health.status_line import StatusLine
from hsslam_services.launch.child import Child
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.launch.one_shot import run_one_shot
from hsslam_services.launch.process_table import (
    EVALUATOR,
    MAP_LOADER,
    PROCESSES,
    RECORDER_STAGE,
    SAVER,
    TRACKER_STAGE,
    WARM_UP,
)
from hsslam_services.requests.gateway import Gateway
from hsslam_services.run.memory import MemoryOfAll
from hsslam_services.run.process_result import read_result
from hsslam_services.run.summary import evaluation_line, read_summary, update_summary
from hsslam_services.supervisor.preparation import Prepared

_TICK_S = 0.05
_STARTING_TICK_S = 0.01
_LONGEST_SETTLE_S = 5.0  # for the pose of the last frame, which may be one that cannot be tracked
_LONGEST_REQUEST_S = 60.0  # for a map that a client is saving when the run ends


class RunLoop:
    """Runs until the source ends, a stop signal, or a failure that ends it.

    `signals()`: how many stop signals have come; the first stops in order, the second at once.
    """

    def __init__(
        self, prepared: Prepared, bus: Bus, fork_client: ForkClient, signals: Callable[[], int]
    ) -> None:
        self._signals = signals
        self._info = prepared.info
        self._notices = prepared.router.notices
        self._bus = bus
        self._fork_client = fork_client
        self._events = bus.publisher(topics.EVENT)
        self._listener = Listener(bus)
        self._gateway = Gateway(bus, prepared.info, fork_client.spawn)
        self._status = StatusLine()
        self._memory = MemoryOfAll()
        self._metrics = prepared.metrics
        self._children = {
            spec.name: Child(spec, self._info.path, fork_client.spawn)
            for spec in PROCESSES
            if self._info.options.has_camera_process or not spec.reads_source
        }

    def to_the_end(self) -> int:
        """Run, stop in order, save; returns the exit code."""
        with self._status:
            for text, level in self._notices:
                self._status.say(text, level)
            if spare_cuda := cuda_torch_without_cuda():
                self._status.say(spare_cuda)
            if not warm_stamp().exists():
                self._status.say("compiling kernels for this machine: once, about 40 s")
                self._one_shot(WARM_UP, patience=0)
            self._fork_client.start()
            if self._info.options.map and (error := self._run_alone(MAP_LOADER, patience=0)):
                raise UserError(error)
            for child in self._children.values():
                child.wanted = not child.spec.is_late
            reason = self._until_stop()
            self._status.say(f"stopping: {reason}")
            self._bus.publisher(topics.STOP).put(Stop(reason=reason))
            self._stop_in_order(reason)
        return self._exit_code()

    def kill_all(self) -> None:
        """End every process that still runs."""
        self._gateway.close()
        for child in self._children.values():
            child.kill()

    def _until_stop(self) -> str:
        """Tick until there is a reason to stop."""
        while True:
            self._tick()
            self._want_late_ones()
            if self._signals():
                return "interrupted"
            if self._gateway.wants_stop:
                return "asked to stop"
            for child in self._children.values():
                if child.state == "failed" and self._needs(child):
                    return f"{child.spec.name} cannot be kept running"
            sources = [c for c in self._children.values() if c.spec.reads_source]
            if any(child.state == "failed" for child in sources):
                return "the source cannot be read"
            has_ended = any(child.state == "ended" for child in sources)
            if self._listener.state.source_end is not None or has_ended:
                return "end of source"

    def _want_late_ones(self) -> None:
        """Once tracker and mapper take work; before that they would only slow the start."""
        if self._gateway.is_resetting:
            return
        if all(c.state == "running" for c in self._children.values() if c.spec.ends_run):
            for child in self._children.values():
                child.wanted = True

    def _tick(self) -> None:
        """One turn of the restart loop: hear, act, show."""
        heartbeats, events = self._listener.listen()
        for health in heartbeats:
            if health.process in self._children:
                self._children[health.process].heard(health)
        for child in self._children.values():
            child.tick()
            while child.news:
                self._tell(child.news.pop(0))
        self._fork_client.tick()
        while self._fork_client.news:
            self._tell(self._fork_client.news.pop(0))
        for event in events:
            if event.process != "supervisor":
                self._status.say(f"{event.process}: {event.text}", event.level)
        heard_mb = {name: child.pss_mb for name, child in self._children.items()}
        self._memory.look(heard_mb, self._fork_client.pid)
        state, memory_mb = self._listener.state, self._memory.total_mb
        self._gateway.tick(state, self._children, memory_mb)
        self._status.show(state, self._children, memory_mb)
        self._metrics.tick(
            lambda: take_snapshot(
                self._gateway.status(state, self._children, memory_mb),
                self._gateway.rejected(self._children),
                state,
                self._children,
            )
        )
        is_starting = any(child.state == "starting" for child in self._children.values())
        time.sleep(_STARTING_TICK_S if is_starting else _TICK_S)

    def _tell(self, text: str) -> None:
        self._status.say(text, "warning")
        now = time.time_ns()
        self._events.put(Event(process="supervisor", level="warning", text=text, stamp_ns=now))

    def _stop_in_order(self, reason: str) -> None:
        """Stage by stage; the saver works when the map stands still, the recorder logs its mesh."""
        stop_ns = time.time_ns()
        self._gateway.is_stopping = True
        deadline_s = time.monotonic() + _LONGEST_REQUEST_S
        while self._gateway.is_busy and self._signals() < 2 and time.monotonic() < deadline_s:
            self._tick()
        for stage in sorted({child.spec.stop_stage for child in self._children.values()}):
            if stage == TRACKER_STAGE:
                self._settle()
            if stage == RECORDER_STAGE:
                self._one_shot(SAVER)
            self._stop_stage(stage)
        if self._info.options.evaluate:
            self._one_shot(EVALUATOR)
            if evaluation := read_summary(self._info.path).get("evaluation"):
                self._status.say(evaluation_line(evaluation))
        for name in self._children:
            update_summary(self._info.path, read_result(self._info.path, name).summary)
        section = process_section(self._info, self._children, self._listener.state, reason, stop_ns)
        section |= self._memory.section() | self._gateway.section(self._children)
        update_summary(self._info.path, section)

    def _stop_stage(self, stage: int) -> None:
        of_stage = [c for c in self._children.values() if c.spec.stop_stage == stage]
        for child in of_stage:
            child.wanted = False
        while any(child.is_alive for child in of_stage) and self._signals() < 2:
            self._tick()
        for child in of_stage:
            child.kill()

    def _settle(self) -> None:
        """Wait for the answer to the last frame that the source has sent."""
        deadline_s = time.monotonic() + _LONGEST_SETTLE_S
        while time.monotonic() < deadline_s and self._signals() < 2:
            self._tick()
            state, tracker = self._listener.state, self._children["tracker"]
            if state.source_end is None or not tracker.is_alive:
                return
            dropped = frames_dropped(self._children)
            if state.has_answered(state.source_end, dropped):
                return

    def _one_shot(self, module: str, patience: int = 1) -> None:
        """Run a process to its end while the others are served, and tell if it fails."""
        error = self._run_alone(module, patience)
        if error and self._signals() <= patience:
            self._tell(f"{module.rpartition('.')[2]}: {error}")

    def _run_alone(self, module: str, patience: int) -> str:
        """The same; returns "" or what went wrong. More signals than `patience` cancel it."""
        is_cancelled = lambda: self._signals() > patience  # noqa: E731
        return run_one_shot(
            module, self._info.path, self._tick, is_cancelled, self._fork_client.spawn
        )

    def _exit_code(self) -> int:
        """What to tell the shell; says which processes were restarted."""
        if self._signals() > 1:
            return 1
        for child in self._children.values():
            if child.user_error and (self._needs(child) or child.spec.reads_source):
                raise UserError(child.user_error)
        for child in self._children.values():
            if child.restarts:
                self._status.say(f"{child.spec.name} was restarted {child.restarts} x", "warning")
        self._status.say(f"results: {self._info.run_dir}")
        failed = [c for c in self._children.values() if c.state == "failed" and self._needs(c)]
        return 1 if failed else 0

    def _needs(self, child: Child) -> bool:
        return child.spec.is_needed(self._info.options.pace)
