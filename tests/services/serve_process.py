"""`hsslam-serve` as a user runs it, for tests: started, watched from outside, ended."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from hsslam_proto import topics
from hsslam_proto.messages import Health
from hsslam_services.bus.bus import Bus, free_endpoint

SMALL_ROOM = (
    *("--source", "synth:room", "--synth.width-px", "160", "--synth.height-px", "120"),
    *("--rate-hz", "15", "--slam.mapper.first-iterations", "40", "--slam.mapper.rays", "256"),
    *("--slam.ba.rays", "256", "--slam.mesher.final-voxel-m", "0.08", "--no-evaluate"),
)


class ServeProcess:
    """A running `hsslam-serve` on a free port, with a client on its bus once `listen` is called."""

    def __init__(self, out: Path, *options: str, prefix: tuple[str, ...] = ()) -> None:
        self.out = out
        self.endpoint = free_endpoint()
        self.port = int(self.endpoint.rpartition(":")[2])
        self.poses: list[Any] = []
        self._log = (out.parent / f"{out.name}.stderr").open("w+")
        self._bus: Bus | None = None
        command = [*prefix, sys.executable, "-m", "hsslam_services.commands.serve"]
        places = ["--out", str(out), "--zenoh-port", str(self.port), "--viewer", "none"]
        self.process = subprocess.Popen(
            [*command, *places, *options], stdout=subprocess.DEVNULL, stderr=self._log
        )

    @property
    def stderr(self) -> str:
        """What the user has read so far."""
        self._log.seek(0)
        return self._log.read()

    @property
    def bus(self) -> Bus:
        """A client, as an outsider's; waits for the router."""
        if self._bus is None:
            self.wait_until(lambda: _port_listens(self.port), 30)
            self._bus = Bus(self.endpoint, "robot", "test")
            self._health_subscription = self._bus.subscribe(topics.HEALTH, 1024)
            self._pose_subscription = self._bus.subscribe(topics.POSE, 4096, history=True)
        return self._bus

    def wait_until(self, condition: Callable[[], object], timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert self.process.poll() is None, f"ended early: {self.stderr}"
            assert time.monotonic() < deadline, f"too late: {self.stderr}"
            time.sleep(0.02)

    def wait_for_poses(self, count: int, timeout_s: float = 180) -> None:
        """Return when so many more poses have been published."""
        assert self.bus
        wanted = len(self.poses) + count

        def arrived() -> bool:
            self.poses.extend(self._pose_subscription.drain())
            return len(self.poses) >= wanted

        self.wait_until(arrived, timeout_s)

    def heartbeats(self, name: str, count: int = 2) -> list[Health]:
        """The next heartbeats of a process; what it had at hand when the first was sent is done."""
        assert self.bus
        self._health_subscription.drain()
        found: list[Health] = []

        def arrived() -> bool:
            found.extend(h for h in self._health_subscription.drain() if h.process == name)
            return len(found) >= count

        self.wait_until(arrived, 30)
        return found

    def pid_of(self, name: str) -> int | None:
        """Process id of a worker, None while it does not live."""
        for child in psutil.Process(self.process.pid).children():
            try:
                words = " ".join(child.cmdline()).split()  # of a forked process they are one
                if any(w.startswith("hsslam_") and w.endswith(f".{name}") for w in words):
                    return child.pid
            except psutil.Error:
                continue
        return None

    def kill_worker(self, name: str) -> None:
        """SIGKILL it, and wait until its successor is there."""
        old = self.pid_of(name)
        assert old is not None
        psutil.Process(old).kill()
        self.wait_until(lambda: self.pid_of(name) not in (None, old), 15)

    def signal(self, number: signal.Signals = signal.SIGINT) -> None:
        self.process.send_signal(number)

    def finish(self, timeout_s: float = 180) -> int:
        """Exit code of its end."""
        self.close_bus()
        try:
            return self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f"does not end: {self.stderr}") from None

    def summary(self) -> dict[str, Any]:
        return json.loads((self.out / "summary.json").read_text())

    def expect_nothing_left(self, timeout_s: float = 0.0) -> None:
        """No process, no shared memory and no port of the run, at the latest after `timeout_s`."""
        deadline = time.monotonic() + timeout_s
        while (left := self._left()) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert left == []

    def close_bus(self) -> None:
        if self._bus is not None:
            self._bus.close()
            self._bus = None

    def close(self) -> None:
        """End it by force; for fixtures."""
        self.close_bus()
        if self.process.poll() is None:
            for process in psutil.Process(self.process.pid).children(recursive=True):
                process.kill()
            self.process.kill()
            self.process.wait()
        self._log.close()

    def _left(self) -> list[str]:
        left = [
            " ".join(p.info["cmdline"])
            for p in psutil.process_iter(["cmdline", "status"])
            if str(self.out) in (p.info["cmdline"] or []) and p.info["status"] != "zombie"
        ]
        if (self.out / "run.json").exists():
            arena = json.loads((self.out / "run.json").read_text())["arena_dir"]
            left += [arena] if Path(arena).exists() else []
        return left + ([f"port {self.port}"] if _port_listens(self.port) else [])


def _port_listens(port: int) -> bool:
    connections = psutil.net_connections("tcp")
    return any(c.status == psutil.CONN_LISTEN and c.laddr.port == port for c in connections)
