"""One supervised process: started, watched, restarted, stopped."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from hsslam_node.kernels.cache_folder import kernel_cache_folder
from hsslam_node.proto.messages import Health
from hsslam_node.services.process_table import ProcessSpec, environment_of_threads
from hsslam_node.services.restart_policy import RestartPolicy

State = Literal["waiting", "starting", "running", "stalled", "ended", "failed"]
_USER_ERROR = 2


class Child:
    """A row of the process table in the flesh.

    `wanted` says whether it should run; `tick` makes it so. `ended`: exited as it should; `failed`:
    given up on (crash loop, or bad input: then `user_error` has the line to show).
    """

    def __init__(self, spec: ProcessSpec, run_dir: Path) -> None:
        self.spec = spec
        self.wanted = False
        self.state: State = "waiting"
        self.restarts = 0
        self.user_error = ""
        self.health: Health | None = None
        self.peak_rss_bytes = 0
        self.news: list[str] = []  # what the operator should read; the supervisor takes it
        self._run_dir = run_dir
        self._policy = RestartPolicy(spec.first_delay_s, spec.longest_delay_s)
        self._process: subprocess.Popen | None = None
        self._start_at_s = 0.0
        self._started_s = 0.0
        self._beat_s = 0.0
        self._stop_sent_s = 0.0

    @property
    def is_alive(self) -> bool:
        return self._process is not None

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    def heard(self, health: Health) -> None:
        """A heartbeat of the process of this name; one of a dead predecessor is ignored."""
        self.peak_rss_bytes = max(self.peak_rss_bytes, health.rss_bytes)
        if health.pid == self.pid:
            self.health = health
            self._beat_s = time.monotonic()
            stalled = health.counters.get("idle_ms", 0) > 1e3 * self.spec.stall_timeout_s
            if self.state != "ended" and health.state != "stopping":
                running = health.state == "running"
                self.state = (
                    "stalled" if running and stalled else "running" if running else "starting"
                )

    def tick(self) -> None:
        """Bring the process to what is wanted; never blocks."""
        now = time.monotonic()
        if self._process is not None and self._process.poll() is not None:
            self._exited(self._process.returncode, now)
        if self.wanted and self._process is None and self.state == "waiting":
            if now >= self._start_at_s:
                self._start(now)
        elif self._process is not None and self.wanted:
            self._kill_if_hung(now)
        elif self._process is not None:
            self._stop(now)

    def kill(self) -> None:
        """End it at once and wait for it."""
        self.wanted = False
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._exited(self._process.returncode, time.monotonic())

    def _start(self, now: float) -> None:
        self._process = spawn(self.spec.module, self._run_dir, self.spec.threads)
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
        how = (
            f"was killed by {signal.Signals(-code).name}"
            if code < 0
            else f"exited with code {code}"
        )
        delay_s = self._policy.failed(now)
        if delay_s is None:
            self.state = "failed"
            log = log_path(self._run_dir, self.spec.module)
            self.news.append(f"{self.spec.name} {how}: too many restarts, given up; see {log}")
            return
        self.restarts += 1
        self.state, self._start_at_s = "waiting", now + delay_s
        self.news.append(f"{self.spec.name} {how}: restart in {delay_s:g} s")

    def _kill_if_hung(self, now: float) -> None:
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


def spawn(module: str, run_dir: Path, threads: int = 1) -> subprocess.Popen:
    """Start `python -m <module> --run <run_dir>` in a session of its own, its output in logs/."""
    log_file = log_path(run_dir, module)
    log_file.parent.mkdir(exist_ok=True)
    environment: Mapping[str, str] = {
        "NUMBA_CACHE_DIR": str(kernel_cache_folder()),
        **os.environ,
        **environment_of_threads(threads),
        "PYTHONUNBUFFERED": "1",
    }
    with log_file.open("ab") as log:
        return subprocess.Popen(
            [sys.executable, "-m", module, "--run", str(run_dir)],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )


def log_path(run_dir: Path, module: str) -> Path:
    """Where a process's own output goes."""
    return run_dir / "logs" / f"{module.rpartition('.')[2]}.log"


def last_error(run_dir: Path, module: str) -> str:
    """The last `error: ...` line of a process's log, without the prefix."""
    lines = log_path(run_dir, module).read_text(errors="replace").splitlines()
    errors = [line.removeprefix("error: ") for line in lines if line.startswith("error: ")]
    return errors[-1] if errors else f"{module} failed; see {log_path(run_dir, module)}"
