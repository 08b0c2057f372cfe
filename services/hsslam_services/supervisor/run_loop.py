"""The loop of the supervisor: keeps the processes of a run running, and ends them in order."""

import contextlib
import datetime
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from hsslam_node.device.torch_build import cuda_torch_without_cuda
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import has_run_kernels
from hsslam_proto import topics
from hsslam_proto.run_messages import Event, Stop
from hsslam_services.arena.arena_folder import pose_count
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import STEP_S, DiskWatch, DiskWork
from hsslam_services.health.run_state import Listener
from hsslam_services.health.snapshot import take_snapshot
from hsslam_services.health.status import process_section
from hsslam_services.health.status_line import StatusLine
from hsslam_services.launch.child import Child
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.launch.one_shot import run_one_shot
from hsslam_services.launch.process_table import (
    MAP_LOADER,
    WARM_UP,
    ProcessSpec,
    one_shot_timeout_s,
    processes_of,
)
from hsslam_services.launch.spawn import process_name
from hsslam_services.requests.gateway import Gateway
from hsslam_services.run.exit_code import ExitCode, ending
from hsslam_services.run.memory import MemoryOfAll
from hsslam_services.run.process_result import read_result
from hsslam_services.run.summary import evaluation_line, read_summary, update_summary
from hsslam_services.security.certificate_validity import CertificateWarnings
from hsslam_services.supervisor.guard import Guard
from hsslam_services.supervisor.kept_watchdog import KeptWatchdog
from hsslam_services.supervisor.orderly_end import OrderlyEnd
from hsslam_services.supervisor.preparation import Prepared
from hsslam_services.supervisor.replacement import Replacement
from hsslam_services.supervisor.stop_reason import StopReason, of_processes, user_error

_TICK_S = 0.05
_STARTING_TICK_S = 0.01
_LONGEST_REQUEST_S = 60.0  # for a save, reset or removal in progress when the run ends


class RunLoop:
    """Runs until the source ends, a stop signal comes, or a failure ends the run.

    `signals()`: number of stop signals so far; the first stops in order, the second at once.
    `not_saved`: the error of each artefact that is not saved; `given_up`: those that a second signal cut
    short.
    """

    def __init__(
        self,
        prepared: Prepared,
        bus: Bus,
        fork_client: ForkClient,
        watchdog: KeptWatchdog,
        signals: Callable[[], int],
        disk: DiskWork,
    ) -> None:
        self.not_saved: Mapping[str, str] = {}
        self.given_up: Sequence[str] = ()
        self._signals = signals
        self._info = prepared.info
        self._notices = prepared.notices
        self._bus = bus
        self._fork_client = fork_client
        self._watchdog = watchdog
        self._events = bus.publisher(topics.EVENT)
        self._listener = Listener(bus)
        self._disk = disk
        self._disk_watch = DiskWatch(disk, prepared.info.path)
        self._gateway = Gateway(bus, prepared.info, fork_client.spawn, disk)
        self._status = StatusLine()
        self._guard = Guard(lambda text: self._status.say(text, "error"))
        self._memory = MemoryOfAll()
        self._metrics = prepared.metrics
        self._replacement = Replacement(prepared.replaced)
        self._certificate = CertificateWarnings(prepared.router.certificate_validity)
        self._children = {
            spec.name: Child(
                spec,
                self._info.path,
                fork_client.spawn,
                partial(self._may_pass, spec),
                self._has_source_ended,
                disk,
            )
            for spec in processes_of(self._info.options)
        }

    def _may_pass(self, spec: ProcessSpec) -> bool:
        """Whether an error of this process may pass: it is no reason to refuse the input of the run."""
        return self._listener.state.has_worked or not spec.can_refuse(self._info.options.pace)

    def _has_source_ended(self) -> bool:
        return self._listener.state.source_end is not None

    def to_the_end(self) -> ExitCode:
        """Run, stop in order, save; returns the exit code.

        Raises:
            UserError: the input is bad; found before the first map.
        """
        with self._status:
            for text, level in self._notices:
                self._status.say(text, level)
            if spare_cuda := cuda_torch_without_cuda():
                self._status.say(spare_cuda)
            if not has_run_kernels(self._info.options.grid):
                self._status.say("compiling kernels for this machine: once, about a minute")
                if error := self._run_first(WARM_UP):
                    self._report(f"warm_up: {error}")
            if not self._should_end():  # else savers would wait for kernels that it compiles
                self._guard.run("fork server", self._fork_client.start)
            if self._info.options.map:
                if error := self._run_first(MAP_LOADER):
                    raise UserError(error)
                self._listener.state.last_keyframe = self._loaded_keyframes() - 1
            if not self._should_end():
                self._gateway.is_loading = False
                for child in self._children.values():
                    child.wanted = not child.spec.is_late
            reason = self._until_stop()
            self._status.say(f"stopping: {reason.text}")
            self._guard.run("stop", lambda: self._announce(reason))
            self._end_in_order(reason)
        return self._exit_code(reason)

    def kill_all(self) -> None:
        """Kill every process that still runs, and write the remaining output."""
        self._guard.run("requests", self._gateway.close)
        for child in self._children.values():
            self._guard.run(child.spec.name, child.kill)
        self.drain()

    def drain(self) -> None:
        """Write the remaining output."""
        self._status.drain()

    def _until_stop(self) -> StopReason:
        """Tick until there is a reason to stop."""
        while True:
            self._tick()
            self._start_late_processes()
            if self._signals():
                return StopReason("interrupted")
            if self._gateway.wants_stop:
                return StopReason("asked to stop")
            if part := self._guard.hopeless_part():
                return StopReason(f"the supervisor cannot go on: {part}", True)
            has_ended = self._listener.state.source_end is not None
            if reason := of_processes(
                self._children.values(), self._info.options.pace, has_source_ended=has_ended
            ):
                return reason

    def _start_late_processes(self) -> None:
        """Start the other processes once tracker and mapper run; earlier they would slow the start."""
        if self._gateway.is_resetting:
            return
        if all(c.state == "running" for c in self._children.values() if c.spec.ends_run):
            for child in self._children.values():
                child.wanted = True

    def _tick(self) -> None:
        """One turn of the loop: receive, act, show. A part that raises is reported; the others still run."""
        guard = self._guard
        guard.run("messages", self._receive, is_needed=True)
        for child in self._children.values():
            guard.run(child.spec.name, child.tick, is_needed=True)
        guard.run("fork server", self._fork_client.tick)
        guard.run("watchdog", self._watchdog.tick)
        guard.run("disk", self._disk_watch.tick)
        guard.run("news", self._report_news)
        guard.run("results of the run before", self._replace_results)
        guard.run("memory", self._measure_memory)
        state, memory_mb = self._listener.state, self._memory.total_mb
        guard.run("requests", lambda: self._gateway.tick(state, self._children, memory_mb))
        guard.run("status", lambda: self._status.show(state, self._children, memory_mb))
        guard.run("metrics", self._update_metrics)
        is_starting = any(child.state == "starting" for child in self._children.values())
        time.sleep(_STARTING_TICK_S if is_starting else _TICK_S)

    def _receive(self) -> None:
        heartbeats, events = self._listener.listen()
        for health in heartbeats:
            if health.process in self._children:
                self._children[health.process].heard(health)
        for event in events:
            if event.process != "supervisor":
                self._status.say(f"{event.process}: {event.text}", event.level)

    def _report_news(self) -> None:
        if warning := self._certificate.take(datetime.datetime.now(datetime.UTC)):
            self._report(warning)
        others = (self._fork_client, self._watchdog, self._disk_watch)
        for reporter in (*self._children.values(), *others):
            while reporter.news:
                self._report(reporter.news.pop(0))

    def _replace_results(self) -> None:
        """Remove or keep the results of the previous run as soon as this one cannot be refused any more."""
        if name := self._replacement.tick(may_be_refused=self._may_be_refused):
            text = f"the previous run did not end in order: its results are in {name}"
            self._status.say(f"--out {self._info.run_dir}: {text}")

    @property
    def has_begun_to_replace(self) -> bool:
        """Whether the results of the previous run are being removed or kept, or have been."""
        return self._replacement.has_begun

    @property
    def _may_be_refused(self) -> bool:
        """Whether bad input still refuses the run: there is no map and at most one pose."""
        return self._listener.state.map is None and not self._listener.state.has_worked

    def _measure_memory(self) -> None:
        heard_mb = {name: child.pss_mb for name, child in self._children.items()}
        self._memory.look(heard_mb, self._fork_client.pid)

    def _update_metrics(self) -> None:
        self._metrics.tick(
            lambda: take_snapshot(
                self._gateway.status(self._listener.state, self._children, self._memory.total_mb),
                self._gateway.rejected(self._children),
                self._listener.state,
                self._children,
                self._certificate.days_left(datetime.datetime.now(datetime.UTC)),
                self._disk.silent_s(),
            )
        )

    def _report(self, text: str) -> None:
        self._status.say(text, "warning")
        self._events.put(Event.now("supervisor", "warning", text))

    def _announce(self, reason: StopReason) -> None:
        self._bus.publisher(topics.STOP).put(Stop(reason=reason.text))

    def _end_in_order(self, reason: StopReason) -> None:
        """End all processes, save all artefacts, complete the summary."""
        stop_s = time.monotonic()
        self._gateway.begin_stop()
        self._wait_while(lambda: self._gateway.is_resetting)
        end = OrderlyEnd(
            self._info,
            self._children,
            self._listener.state,
            self._tick,
            self._run_alone,
            self._signals,
            lambda text: self._guard.run("events", lambda: self._report(text)),
            disk=self._disk,
        )
        end.to_the_end()
        self._wait_while(lambda: self._gateway.is_busy)
        try:
            summary = self._disk.do(
                lambda: self._summary(reason, stop_s, end),
                STEP_S,
                is_hurried=lambda: self._signals() > 1,
            )
            if evaluation := summary.get("evaluation"):
                self._status.say(evaluation_line(evaluation, summary.get("frames", {})))
        except OSError as error:
            end.miss("summary", f"{self._info.path}: {error.strerror}")
        self.not_saved, self.given_up = end.not_saved, end.given_up
        # last, as `docker stop` grants 10 s: the next run removes what is left
        self._wait_while(lambda: self._replacement.is_going_on)

    def _wait_while(self, is_busy: Callable[[], bool]) -> None:
        """Let a client's request or a removal finish, for a limited time."""
        deadline_s = time.monotonic() + _LONGEST_REQUEST_S
        while is_busy() and self._signals() < 2 and time.monotonic() < deadline_s:
            self._tick()

    def _summary(self, reason: StopReason, stop_s: float, end: OrderlyEnd) -> dict[str, Any]:
        """Complete the summary; returns it. Runs in the thread for file work, while the loop waits."""
        path = self._info.path
        for name in self._children:
            update_summary(path, read_result(path, name).summary)
        section: dict[str, Any] = process_section(
            self._info, self._children, self._listener.state, reason.text, stop_s
        )
        section |= self._memory.section() | self._gateway.section(self._children)
        section |= {"not_saved": end.not_saved, "given_up": end.given_up}
        section |= {"not_evaluated": end.not_evaluated}
        section |= {"supervisor_failures": self._guard.failures, "end_s": end.done_s}
        section["exit_code"] = int(self._code(reason, is_saved=not end.not_saved))
        update_summary(path, section)
        return read_summary(path)

    def _run_alone(self, module: str, is_cancelled: Callable[[], bool]) -> str:
        """Run a process to its end while the loop goes on; returns "" or the error."""
        timeout_s = one_shot_timeout_s(module, pose_count(Path(self._info.arena_dir)))
        return run_one_shot(
            module,
            self._info.path,
            self._tick,
            is_cancelled,
            timeout_s,
            self._fork_client.spawn,
            self._disk,
        )

    def _run_first(self, module: str) -> str:
        """Run a process before the others; returns its error, or "" if the run should end meanwhile."""
        error = self._run_alone(module, self._should_end)
        return "" if self._should_end() else error

    def _loaded_keyframes(self) -> int:
        """The number of keyframes in the map of `--map`, by the result of its loader; 0: it is unknown."""
        path, name = self._info.path, process_name(MAP_LOADER)
        with contextlib.suppress(TimeoutError):
            loaded = self._disk.do(
                lambda: read_result(path, name), STEP_S, self._tick, self._should_end
            )
            return loaded.summary.get("keyframes", 0)
        return 0

    def _should_end(self) -> bool:
        """Whether a signal or a client has asked for the end."""
        return self._signals() > 0 or self._gateway.wants_stop

    def _exit_code(self, reason: StopReason) -> ExitCode:
        """The exit code; prints the restarts and the run folder."""
        code = self._code(reason, is_saved=not self.not_saved)
        if code == ExitCode.CUT_SHORT:
            return code
        if code == ExitCode.BAD_INPUT:
            raise UserError(self._user_error)
        if self._user_error:
            self._status.say(f"error: {self._user_error}", "error")
        for child in self._children.values():
            if child.restarts:
                self._status.say(f"{child.spec.name} was restarted {child.restarts} x", "warning")
        self._status.say(f"results: {self._info.run_dir}")
        return code

    @property
    def _user_error(self) -> str:
        """The error of a needed process that has refused its input; "" if there is none."""
        return user_error(self._children.values(), self._info.options.pace)

    def _code(self, reason: StopReason, *, is_saved: bool) -> ExitCode:
        return ending(
            is_cut_short=self._signals() > 1,
            is_refused=bool(self._user_error) and self._may_be_refused,
            has_failed=reason.is_failure,
            is_saved=is_saved,
        )
