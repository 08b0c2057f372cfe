"""The supervisor's side of one process: start, watch, restart, stop."""

import contextlib
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from hsslam_proto.run_messages import Health
from hsslam_services.bus.dead_pools import free_pools
from hsslam_services.bus.zenoh_session import most_pool_bytes
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.core_wait import CoreWait
from hsslam_services.launch.process_table import ProcessSpec, process_number
from hsslam_services.launch.restart_policy import RestartPolicy
from hsslam_services.launch.spawn import (
    Process,
    Spawn,
    how_it_ended,
    last_error,
    log_path,
    not_started,
    spawn,
)
from hsslam_services.run.memory import oom_kills
from hsslam_services.run.process_result import ProcessResult, clear_result, read_result
from hsslam_services.run.stop_signals import END_SIGNAL

State = Literal["waiting", "starting", "running", "stalled", "ended", "failed"]
_USER_ERROR = 2
_ORDERLY = (0, -END_SIGNAL)  # the signal kills a process without a handler
_OWN_PAUSE_S = 2.0  # a longer one between ticks: the whole run was frozen, as by `docker pause`
_PATIENCE_S = 10.0  # after such a pause, before a process counts as hung
_KILL_TIMEOUT_S = 10.0  # for the kernel: a process may hang in a driver
_QUIET_SHARE = 0.3  # of a time limit, after which the supervisor looks at the threads of a process
_RESULT_S = 10.0  # from the exit of a process until a slow disk gives its result
_LAST_MESSAGE_S = 2.0  # from the exit of a process until its last message is here
_MOST_STARVED = 8.0  # times a time limit that a process may take if it waits for a core


class Child:
    """Starts, watches and restarts one process according to its row of the process table.

    `wanted`: whether the process should run; `tick` starts or stops it. State "ended": it exited as it
    should; "failed": it is not started again, after a crash loop or bad input (`user_error`).
    `may_pass()`: whether an error, as a lack of memory or of the router, may pass; else it is bad input. A
    process that reads the source comes back only after a lack of memory.
    `has_source_ended()`: whether a process that may finish has sent its last frame.
    """

    def __init__(
        self,
        spec: ProcessSpec,
        run_dir: Path,
        spawn: Spawn = spawn,
        may_pass: Callable[[], bool] = lambda: False,
        has_source_ended: Callable[[], bool] = lambda: True,
        disk: DiskWork | None = None,
    ) -> None:
        self.spec = spec
        self.wanted = False
        self.state: State = "waiting"
        self.restarts = 0
        self.user_error = ""
        self.exit_code: int | None = None  # of the last process; negative: killed by this signal
        self.health: Health | None = None
        self.peak_rss_bytes = 0
        self.news: list[str] = []  # lines for the operator; the supervisor takes them
        self._run_dir = run_dir
        self._disk = disk or DiskWork()
        self._spawn = spawn
        self._may_pass = may_pass
        self._has_source_ended = has_source_ended
        # when it exited with code 0, while its last message may still come
        self._finished_s: float | None = None
        # when it exited with an error that the disk has not given yet
        self._unexplained_s: float | None = None
        self._oom_kills = 0  # of the system when it was started
        self._policy = RestartPolicy(spec.first_delay_s, spec.longest_delay_s)
        self._process: Process | None = None
        self._start_at_s = 0.0
        self._started_s = 0.0
        self._worked_since_s: float | None = None
        self._beat_s = 0.0
        self._counted_earlier: dict[str, int] = {}
        self._stop_sent_s = 0.0
        self._loop_s = 0.0
        self._killed_s = 0.0
        self._ticked_s = time.monotonic()
        self._patient_until_s = 0.0
        self._core_wait: CoreWait | None = None  # while the process is quiet
        self._has_reported_wait = False

    @property
    def is_alive(self) -> bool:
        return self._process is not None

    @property
    def is_restarting(self) -> bool:
        """Whether it should run, has crashed, and does not run again yet."""
        return self.wanted and self.restarts > 0 and self.state in ("waiting", "starting")

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    @property
    def pss_mb(self) -> int:
        """Memory by the last heartbeat; 0 if the process is dead."""
        return self.health.pss_mb if self.health and self.is_alive else 0

    def counted(self, name: str) -> int:
        """A counter that a restarted process continues, by the last heartbeat that had it."""
        own = self.health.counters if self.health else {}
        return own.get(name, self._counted_earlier.get(name, 0))

    def heard(self, health: Health) -> None:
        """Take in a heartbeat of this process; ignores those of a dead predecessor."""
        self.peak_rss_bytes = max(self.peak_rss_bytes, health.rss_bytes)
        if health.pid == self.pid:
            self.health = health
            self._beat_s = time.monotonic()
            self._loop_s = self._beat_s - 1e-3 * health.idle_ms
            stalled = health.idle_ms > 1e3 * self.spec.stall_timeout_s
            if self.state != "ended" and health.state != "stopping":
                running = health.state == "running"
                if running and self._worked_since_s is None:
                    self._worked_since_s = self._beat_s
                self.state = (
                    "stalled" if running and stalled else "running" if running else "starting"
                )

    def tick(self) -> None:
        """Start, check or stop the process, as wanted; a disk that hangs costs at most a second."""
        now = time.monotonic()
        self._forgive_own_pause(now)
        if self._process is not None and (code := self._process.poll()) is not None:
            self._exited(code, now)
            if self._unexplained_s is not None:
                return
        if self._process is not None and self._killed_s:
            if self._is_overdue(now - self._killed_s, _KILL_TIMEOUT_S, now):
                self._abandon()
            return
        if self._finished_s is not None:
            self._confirm_end(now - self._finished_s, now)
        elif self.wanted and self._process is None and self.state == "waiting":
            if now >= self._start_at_s:
                self._start(now)
        elif self._process is not None and self.wanted:
            self._kill_if_hung(now)
        elif self._process is not None:
            self._stop(now)

    def renew(self) -> None:
        """Let an ended process start again; a failed one stays failed."""
        if self.state == "ended" and self._process is None:
            self.state, self._start_at_s = "waiting", 0.0

    def kill(self, within_s: float = _KILL_TIMEOUT_S) -> None:
        """Kill the process and wait for its end, at most `within_s`; a process may hang in a driver."""
        self.wanted = False
        if self._process is None:
            return
        self._process.kill()
        self._killed_s = time.monotonic()
        try:
            self._exited(self._process.wait(within_s), time.monotonic())
        except subprocess.TimeoutExpired:
            self._abandon()

    def _start(self, now: float) -> None:
        if self.health is not None:
            self._counted_earlier |= self.health.counters
        self._stop_sent_s, self._killed_s, self.health = 0.0, 0.0, None
        self._core_wait, self._has_reported_wait = None, False
        self._worked_since_s = None
        self._oom_kills = oom_kills()
        try:
            free_pools(process_number(self.spec.name), most_pool_bytes())
            with contextlib.suppress(TimeoutError):  # then an old error may be told for a new one
                self._disk.do(lambda: clear_result(self._run_dir, self.spec.name))
            self._process = self._spawn(self.spec.module, self._run_dir)
        except (OSError, MemoryError) as error:  # no descriptors, processes or disk space
            self._failed(not_started(error), now)
        else:
            self.state, self._started_s = "starting", now

    def _abandon(self) -> None:
        """Stop waiting for a process that the kernel cannot kill."""
        self.news.append(f"{self.spec.name} (process {self.pid}) cannot be killed: left running")
        self._process, self.state = None, "failed"

    def _exited(self, code: int, now: float) -> None:
        is_user_error = code == _USER_ERROR
        result = self._result() if is_user_error else ProcessResult()
        if result is None and self._is_explained_later(now):
            return
        self._process, self.exit_code, self._unexplained_s = None, code, None
        error = last_error(result or ProcessResult(), self._run_dir, self.spec.module)
        how = f"ended: {error}" if is_user_error else how_it_ended(code)
        if code == -signal.SIGKILL and not self._killed_s and oom_kills() > self._oom_kills:
            how += ", out of memory (in a container: --memory)"
        if not self.wanted:
            self.state = "ended"
            if code not in _ORDERLY and not self._killed_s:
                self.news.append(f"{self.spec.name} {how} while it ended")
        elif code == 0 and self.spec.may_finish:
            self._finished_s = now
            self._confirm_end(0.0, now)
        elif not is_user_error or self._may_come_back(result):
            self._failed(how, now)
        else:
            self.state = "failed"
        if is_user_error and self.state == "failed":
            self.user_error = error

    def _confirm_end(self, since_s: float, now: float) -> None:
        """Count exit code 0 as the end once the source has ended; a driver may have ended the process."""
        if not self.wanted or self._has_source_ended():
            self._finished_s, self.state = None, "ended"
        elif since_s > _LAST_MESSAGE_S:
            self._finished_s = None
            self._failed("exited with code 0 before the end of its source", now)

    def _result(self) -> ProcessResult | None:
        """The result of the process; None: the disk does not answer."""
        try:
            return self._disk.do(lambda: read_result(self._run_dir, self.spec.name))
        except TimeoutError:
            return None

    def _is_explained_later(self, now: float) -> bool:
        """Whether a later tick asks for the result again; an end that was wanted does not wait for it."""
        if self._unexplained_s is None:
            self._unexplained_s = now
        return self.wanted and now - self._unexplained_s < _RESULT_S

    def _may_come_back(self, result: ProcessResult | None) -> bool:
        """Whether the cause of a user error may pass: a lack of memory or of the router, no bad input.

        An unknown cause (None) may pass.
        """
        lacked_memory = result is None or result.lacks_memory
        return self._may_pass() and (lacked_memory or not self.spec.reads_source)

    def _failed(self, how: str, now: float) -> None:
        """Schedule a restart, or give up."""
        worked_s = 0.0 if self._worked_since_s is None else now - self._worked_since_s
        delay_s = self._policy.failed(now, worked_s)
        if delay_s is None:
            self.state = "failed"
            log = log_path(self._run_dir, self.spec.module)
            self.news.append(f"{self.spec.name} {how}: too many restarts, given up; see {log}")
            return
        self.restarts += 1
        self.state, self._start_at_s = "waiting", now + delay_s
        self.news.append(f"{self.spec.name} {how}: restart in {delay_s:g} s")

    def _forgive_own_pause(self, now: float) -> None:
        """Extend all time limits if the supervisor was frozen, as the process was frozen too."""
        pause_s, self._ticked_s = now - self._ticked_s, now
        if pause_s > _OWN_PAUSE_S:
            self._patient_until_s = now + _PATIENCE_S
            self._started_s += pause_s
            if self._stop_sent_s:
                self._stop_sent_s += pause_s

    def _kill_if_hung(self, now: float) -> None:
        if now < self._patient_until_s:
            return
        assert self._process is not None
        spec = self.spec
        quiet = []  # seconds, limit, what is missing
        if self.health is not None:
            quiet.append((now - self._beat_s, spec.health_timeout_s, "sends no heartbeat for"))
            if self.state in ("running", "stalled"):
                idle_s = 1e-3 * self.health.idle_ms
                quiet.append(
                    (idle_s, spec.stall_timeout_s, "made no progress in its main loop for")
                )
        if self.state == "starting":
            quiet.append((now - self._started_s, spec.startup_timeout_s, "is not ready after"))
        seconds, limit_s, what = max(quiet, key=lambda each: each[0] / each[1])
        if self._is_overdue(seconds, limit_s, now):
            self._kill(f"{what} {limit_s:g} s", now)
        elif seconds > limit_s and not self._has_reported_wait:
            self._has_reported_wait = True
            self.news.append(
                f"{spec.name} {what} {limit_s:g} s: it waits for a core, as other programs use them all"
            )

    def _kill(self, why: str, now: float) -> None:
        assert self._process is not None
        self.news.append(f"{self.spec.name} {why}: killed")
        self._process.kill()
        self._killed_s, self._core_wait = now, None

    def _is_overdue(self, seconds: float, limit_s: float, now: float) -> bool:
        """Whether a time limit has passed; a process that waits for a core of a busy machine has longer."""
        if seconds < _QUIET_SHARE * limit_s:
            self._core_wait = None
            return False
        if self.pid is None:  # only requested: `ForkedProcess` limits how long
            return False
        if self._core_wait is None:
            self._core_wait = CoreWait(self.pid)
        self._core_wait.look(now)
        if seconds <= limit_s:
            return False
        return seconds > _MOST_STARVED * limit_s or not self._core_wait.is_starved()

    def _stop(self, now: float) -> None:
        assert self._process is not None
        if not self._stop_sent_s:
            self._process.send_signal(END_SIGNAL)
            self._process.send_signal(signal.SIGCONT)  # so that a frozen process can end
            self._stop_sent_s = now
            self._core_wait = None
        elif self._is_overdue(
            now - max(self._stop_sent_s, self._loop_s), self.spec.stop_timeout_s, now
        ):
            self._kill(f"did not end in {self.spec.stop_timeout_s:g} s", now)
