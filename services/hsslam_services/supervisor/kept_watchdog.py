"""The supervisor's side of the watchdog: starts it again if it dies, so a killed supervisor stays safe."""

import subprocess
import time
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.one_shot import expect_end, start_watchdog
from hsslam_services.launch.restart_policy import RestartPolicy
from hsslam_services.launch.spawn import how_it_ended

_LATER = "if the supervisor dies too, the next hsslam-serve saves this run"


class KeptWatchdog:
    """The watchdog of a run; `tick` starts it again, until it has failed too often.

    `news`: lines for the operator; the supervisor takes them.

    Raises:
        UserError: the watchdog cannot be started, or its log cannot be written.
    """

    def __init__(
        self,
        run_dir: Path,
        arena_dir: Path,
        policy: RestartPolicy | None = None,
        disk: DiskWork | None = None,
    ) -> None:
        self.news: list[str] = []
        self._run_dir, self._arena_dir = run_dir, arena_dir
        self._disk = disk or DiskWork()
        self._policy = policy or RestartPolicy(first_delay_s=0.5, longest_delay_s=10.0)
        self._process: subprocess.Popen | None = None
        self._due_s: float | None = None  # of the next start; None: it runs, or there were too many
        self._start()

    def tick(self) -> None:
        """Start the watchdog again if it has died."""
        if self._process is not None and self._process.poll() is not None:
            how = how_it_ended(self._process.returncode)
            self._process = None
            self._failed(f"watchdog {how}", time.monotonic() - self._started_s)
        if self._due_s is not None and time.monotonic() >= self._due_s:
            try:
                self._start()
            except UserError as error:
                self._failed(str(error), 0.0)

    def expect_end(self) -> None:
        """Wait for the watchdog after the arena is removed or marked; see `one_shot.expect_end`."""
        if self._process is not None:
            expect_end(self._process)

    def _start(self) -> None:
        self._started_s = time.monotonic()
        self._process = start_watchdog(self._run_dir, self._arena_dir, self._disk)
        self._due_s = None

    def _failed(self, what: str, worked_s: float) -> None:
        now_s = time.monotonic()
        delay_s = self._policy.failed(now_s, worked_s)
        self._due_s = None if delay_s is None else now_s + delay_s
        then = f"too many restarts: {_LATER}" if delay_s is None else f"restart in {delay_s:g} s"
        self.news.append(f"{what}: {then}")
