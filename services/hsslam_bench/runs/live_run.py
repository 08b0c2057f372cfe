"""A running `hsslam-serve`: watch it as a client, kill its processes, wait for its end."""

import contextlib
import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from hsslam_bench.runs.left_behind import LeftBehind, port_listens
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_proto.messages import Pose
from hsslam_proto.request_messages import Ask, Status
from hsslam_proto.requests import STATUS
from hsslam_proto.run_messages import Health
from hsslam_services.bus.ask import NotDoneError, ask
from hsslam_services.bus.bus import Bus, free_endpoint

QUICK = (  # a map that takes seconds
    *("--slam.mapper.first-iterations", "40", "--slam.mapper.rays", "256"),
    *("--slam.ba.rays", "256", "--slam.mesher.final-voxel-m", "0.08"),
)
SMALL_ROOM = (
    *("--source", "synth:room", "--synth.width-px", "160", "--synth.height-px", "120"),
    *("--rate-hz", "15", *QUICK, "--no-evaluate"),
)
SENT_ROOM = ("--source", "zenoh:", *QUICK, "--no-evaluate")  # another program sends the frames
_POLL_S = 0.02
_LOOK_EVERY_S = 0.2
_ASK_EVERY_S = 0.3
_LAST_LINES = 12


class LiveRun:
    """A running `hsslam-serve` on a free port; the first use of `bus` connects a client to it.

    `out`: absolute path, by which the run finds its processes. `prefix`: words before the command. Methods
    that wait raise RunFailedError if the service ends before or takes too long.
    """

    def __init__(
        self, out: Path, *options: str, prefix: tuple[str, ...] = (), viewer: str = "none"
    ) -> None:
        self.out = out
        self.endpoint = free_endpoint()
        self.port = int(self.endpoint.rpartition(":")[2])
        self.poses: list[Pose] = []
        self._messages = out.parent / f"{out.name}.stderr"
        self._bus: Bus | None = None
        command = [*prefix, sys.executable, "-P", "-m", "hsslam_services.commands.serve"]
        places = ["--out", str(out), "--zenoh-port", str(self.port), "--viewer", viewer]
        with self._messages.open("wb") as stderr:
            self.process = subprocess.Popen(
                [*command, *places, *options],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
            )
        self._left_behind = LeftBehind(out, self.port, self.process.pid)

    @property
    def stderr(self) -> str:
        """Standard error of the service so far."""
        return self._messages.read_text(errors="replace")

    @property
    def last_words(self) -> str:
        """The last lines of `stderr`, without the status lines."""
        lines = [line for line in self.stderr.splitlines() if not line.startswith("frame ")]
        return "\n".join(lines[-_LAST_LINES:])

    @property
    def code(self) -> int | None:
        """Exit code; None while it runs."""
        return self.process.poll()

    @property
    def bus(self) -> Bus:
        """An external client; waits for the router."""
        if self._bus is None:
            self.wait_until(lambda: port_listens(self.port), 30)
            self._bus = Bus(self.endpoint, "robot", "test")
            self._health_subscription = self._bus.subscribe(topics.HEALTH, 1024)
            self._pose_subscription = self._bus.subscribe(topics.POSE, 4096, history=True)
        return self._bus

    @property
    def arena_dir(self) -> Path:
        """The folder of its shared memory."""
        return Path(json.loads((self.out / "run.json").read_text())["arena_dir"])

    def wait_until(self, condition: Callable[[], object], timeout_s: float) -> None:
        """Return when the condition is true."""
        deadline = time.monotonic() + timeout_s
        while not condition():
            if self.code is not None:
                raise RunFailedError(
                    f"{self.out.name} ended with code {self.code}: {self.last_words}"
                )
            if time.monotonic() > deadline:
                raise RunFailedError(
                    f"{self.out.name}: timeout after {timeout_s:g} s: {self.last_words}"
                )
            time.sleep(_POLL_S)
        self._left_behind.poll()

    def wait_for_poses(self, count: int, timeout_s: float = 180) -> None:
        """Return when `count` more poses have been published."""
        wanted = len(self.poses) + count
        self.wait_until(lambda: len(self.new_poses()) >= wanted, timeout_s)

    def new_poses(self) -> list[Pose]:
        """All poses that have arrived so far."""
        assert self.bus
        self.poses.extend(self._pose_subscription.drain())
        return self.poses

    def latencies_ms(self, seconds: float) -> list[float]:
        """Time from its stamp to its arrival here of each pose that arrives in the next seconds."""
        assert self.bus
        end_s, found = time.monotonic() + seconds, []
        while (left_s := end_s - time.monotonic()) > 0:
            received = self._pose_subscription.poll_received()
            if received is None:
                self.bus.wait(min(left_s, 0.1))
                continue
            self.poses.append(received.message)
            found.append((received.arrival_ns - received.message.stamp_ns) / 1e6)
        return found

    def wait_until_ready(self, timeout_s: float = 120) -> None:
        """Return when tracker and mapper are running."""

        def is_ready() -> bool:
            states = status.processes if (status := self.status()) else {}
            return states.get("tracker") == states.get("mapper") == "running"

        self.wait_until(is_ready, timeout_s)

    def heartbeats(self, name: str, count: int = 2) -> list[Health]:
        """Wait for the next heartbeats of a process; with two, its work of the first one is done."""
        assert self.bus
        self._health_subscription.drain()
        found: list[Health] = []

        def arrived() -> bool:
            found.extend(h for h in self._health_subscription.drain() if h.process == name)
            return len(found) >= count

        self.wait_until(arrived, 30)
        return found

    def status(self, timeout_s: float = 5.0) -> Status | None:
        """The answer to `hsslam-ctl status`; None without an answer."""
        time.sleep(_ASK_EVERY_S)
        try:
            return ask(self.endpoint, "robot", STATUS, Ask(), timeout_s, connect_s=1.0)
        except (NotDoneError, UserError):
            return None

    def control(self, *words: str, timeout_s: float = 60.0) -> str:
        """Run `hsslam-ctl`; returns what it prints."""
        command = [sys.executable, "-P", "-m", "hsslam_services.commands.ctl", *words]
        try:
            done = subprocess.run(
                [*command, "--connect", self.endpoint],
                capture_output=True,
                text=True,
                timeout=timeout_s,
            )
        except subprocess.TimeoutExpired:
            return f"no answer within {timeout_s:g} s"
        return (done.stdout + done.stderr).strip()

    def pid_of(self, name: str) -> int | None:
        """Process id of a worker; None if it is not running."""
        for child in psutil.Process(self.process.pid).children():
            try:
                words = " ".join(child.cmdline()).split()  # a forked process has one word
                if any(w.startswith("hsslam_") and w.endswith(f".{name}") for w in words):
                    return child.pid
            except psutil.Error:
                continue
        return None

    def kill_worker(self, name: str, timeout_s: float = 15) -> None:
        """Kill a worker, and wait for its successor."""
        old = self.pid_of(name)
        if old is None:
            raise RunFailedError(f"{self.out.name}: {name} is not running: {self.last_words}")
        psutil.Process(old).kill()
        self.wait_until(lambda: self.pid_of(name) not in (None, old), timeout_s)

    def kill_supervisor(self) -> None:
        """Kill the supervisor; its processes live until the watchdog ends them."""
        self.close_bus()
        self.process.kill()
        self.process.wait()

    def signal(self, number: signal.Signals = signal.SIGINT) -> None:
        """Send a signal to the service."""
        self.process.send_signal(number)

    def finish(self, timeout_s: float = 180) -> int:
        """Wait for the end; returns the exit code."""
        if (code := self.ends_within(timeout_s)) is None:
            raise RunFailedError(f"{self.out.name} does not end: {self.last_words}")
        return code

    def ends_within(self, timeout_s: float) -> int | None:
        """Wait for the end; returns the exit code, or None if the service still runs after this time."""
        self.close_bus()
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0:
            self._left_behind.poll()
            with contextlib.suppress(subprocess.TimeoutExpired):
                return self.process.wait(min(left_s, _LOOK_EVERY_S))
        return None

    def summary(self) -> dict[str, Any]:
        """summary.json of the run folder."""
        return json.loads((self.out / "summary.json").read_text())

    def missing(self, *names: str) -> list[str]:
        """Those of these files that the run folder does not have."""
        return [name for name in names if not (self.out / name).is_file()]

    def left_behind(self, timeout_s: float = 0.0) -> list[str]:
        """Processes, shared memory and port of the run that remain after this time."""
        deadline = time.monotonic() + timeout_s
        while (left := self._left_behind.found()) and time.monotonic() < deadline:
            time.sleep(0.05)
        return left

    def close_bus(self) -> None:
        """Disconnect the client."""
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def close(self) -> None:
        """Kill the service and all its processes, and remove its shared memory."""
        self.close_bus()
        if self.code is None:
            self.process.kill()
            self.process.wait()
        for process in self._left_behind.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()
        if (self.out / "run.json").exists() and self.arena_dir.name.startswith("hsslam-"):
            shutil.rmtree(self.arena_dir, ignore_errors=True)
