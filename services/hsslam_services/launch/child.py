"""One supervised process: started, watched, restarted by a policy, stopped."""

import signal
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hsslam_proto.messages import Health
from hsslam_services.launch.process_table import ProcessSpec
from hsslam_services.launch.spawn import Process, Spawn, how_it_ended, last_error, log_path, spawn
from hsslam_services.run.process_result import clear_result

_MOST_RESTARTS = 5
_WINDOW_S = 300.0
State = Literal["waiting", "starting", "running", "stalled", "ended", "failed"]
_USER_ERROR = 2
_OWN_PAUSE_S = 2.0  # between two ticks: the whole run was frozen, as by `docker pause`
_PATIENCE_S = 10.0  # after it, for all to come round


@dataclass
class RestartPolicy:
    """When a process that failed is started again; pure, time is an argument.

    Delays double from `first_delay_s` to `longest_delay_s`; a quiet window starts them anew.

    More than 5 restarts in 300 s are a crash loop.
    """

    first_delay_s: float
    longest_delay_s: float
    _failures_s: list[float] = field(default_factory=list)

    def failed(self, now_s: float) -> float | None:
        """A failure at this time (s, monotonic): seconds to wait, or None to give up."""
        self._failures_s = [t for t in self._failures_s if now_s - t < _WINDOW_S] + [now_s]
        count = len(self._failures_s)
        if count > _MOST_RESTARTS:
            return None
        return min(self.first_delay_s * 2 ** (count - 1), self.longest_delay_s)


class Child:
    """One supervised process: started, watched and restarted according to its row of the process table.

    `wanted` says whether it should run; `tick` makes it so. `ended`: exited as it should; `failed`:
    given up on (crash loop, or bad input: then `user_error` has the line to show).
    """

    def __init__(self, spec: ProcessSpec, run_dir: Path, spawn: Spawn = spawn) -> None:
        self.spec = spec
        self.wanted = False
        self.state: State = "waiting"
        self.restarts = 0
        self.user_error = ""
        self.health: Health | None = None
        self.peak_rss_bytes = 0
        self.news: list[str] = []  # what the operator should read; the supervisor takes it
        self._run_dir = run_dir
        self._spawn = spawn
        self._policy = RestartPolicy(spec.first_delay_s, spec.longest_delay_s)
        self._process: Process | None = None
        self._start_at_s = 0.0
        self._started_s = 0.0
        self._beat_s = 0.0
        self._stop_sent_s = 0.0
        self._ticked_s = time.monotonic()
        self._patient_until_s = 0.0

    @property
    def is_alive(self) -> bool:
        return self._process is not None

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    @property
    def pss_mb(self) -> int:
        """Memory that it told of last; 0 when it does not live."""
        return self.health.pss_mb if self.health and self.is_alive else 0

    def heard(self, health: Health) -> None:
        """A heartbeat of the process of this name; one of a dead predecessor is ignored."""
        self.peak_rss_bytes = max(self.peak_rss_bytes, health.rss_bytes)
        if health.pid == self.pid:
            self.health = health
            self._beat_s = time.monotonic()
            stalled = health.idle_ms > 1e3 * self.spec.stall_timeout_s
            if self.state != "ended" and health.state != "stopping":
                running = health.state == "running"
                self.state = (
                    "stalled" if running and stalled else "running" if running else "starting"
                )

    def tick(self) -> None:
        """Bring the process to what is wanted; never blocks."""
        now = time.monotonic()
        self._forgive_own_pause(now)
        if self._process is not None and (code := self._process.poll()) is not None:
            self._exited(code, now)
        if self.wanted and self._process is None and self.state == "waiting":
            if now >= self._start_at_s:
                self._start(now)
        elif self._process is not None and self.wanted:
            self._kill_if_hung(now)
        elif self._process is not None:
            self._stop(now)

    def renew(self) -> None:
        """Let one that has ended as wanted start again; one that was given up on stays so."""
        if self.state == "ended" and self._process is None:
            self.state, self._start_at_s = "waiting", 0.0

    def kill(self) -> None:
        """End it at once and wait for it."""
        self.wanted = False
        if self._process is not None:
            self._process.kill()
            self._exited(self._process.wait(), time.monotonic())

    def _start(self, now: float) -> None:
        clear_result(self._run_dir, self.spec.name)
        self._process = self._spawn(self.spec.module, self._run_dir)
        self.state, self._started_s, self._stop_sent_s, self.health = "starting", now, 0.0, None

    def _exited(self, code: int, now: float) -> None:
        self._process = None
        if not self.wanted or (code == 0 and self.spec.may_finish):
            self.state = "ended"
            return
        if code == _USER_ERROR:
            self.state = "failed"
            self.user_error = last_error(self._run_dir, self.spec.module)
            return
        how = how_it_ended(code)
        delay_s = self._policy.failed(now)
        if delay_s is None:
            self.state = "failed"
            log = log_path(self._run_dir, self.spec.module)
            self.news.append(f"{self.spec.name} {how}: too many restarts, given up; see {log}")
            return
        self.restarts += 1
        self.state, self._start_at_s = "waiting", now + delay_s
        self.news.append(f"{self.spec.name} {how}: restart in {delay_s:g} s")

    def _forgive_own_pause(self, now: float) -> None:
        """Who was frozen together with its supervisor has missed nothing."""
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
        since_start_s, since_beat_s = now - self._started_s, now - self._beat_s
        if self.state == "stalled":
            why = f"does not come round for {spec.stall_timeout_s:g} s"
        elif self.health is not None and since_beat_s > spec.health_timeout_s:
            why = f"sends no heartbeat for {spec.health_timeout_s:g} s"
        elif self.state == "starting" and since_start_s > spec.startup_timeout_s:
            why = f"is not ready after {spec.startup_timeout_s:g} s"
        else:
            return
        self.news.append(f"{spec.name} {why}: killed")
        self._process.kill()
        self._process.wait()

    def _stop(self, now: float) -> None:
        assert self._process is not None
        if not self._stop_sent_s:
            self._process.terminate()
            self._process.send_signal(signal.SIGCONT)  # one that is frozen can end, too
            self._stop_sent_s = now
        elif now - self._stop_sent_s > self.spec.stop_timeout_s:
            self.news.append(
                f"{self.spec.name} did not end in {self.spec.stop_timeout_s:g} s: killed"
            )
            self._process.kill()
            self._process.wait()
