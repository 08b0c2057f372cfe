"""What a run of `hsslam-serve` leaves behind: processes, shared memory, its port."""

import os
from pathlib import Path

import psutil

from hsslam_services.bus.dead_pools import pools_of
from hsslam_services.run.run_info import RunInfo


class LeftBehind:
    """Finds what is left of the run in `folder`, an absolute path, whose router listens on `port`.

    Call `poll` during the run, every 0.2 s or so: after the run, the files of zenoh do not show their run.
    """

    def __init__(self, folder: Path, port: int, supervisor_pid: int) -> None:
        self._folder = folder
        self._port = port
        self._supervisor_pid = supervisor_pid
        self._pools: set[Path] = set()

    def poll(self) -> None:
        """Take in the files of zenoh that the run's router, in the supervisor, has open now."""
        self._pools |= pools_of(self._supervisor_pid)

    def found(self) -> list[str]:
        """Processes, shared memory and port that are there now."""
        left = [f"process {process.pid}" for process in self.processes()]
        if (arena := self._arena_dir()) and arena.exists():
            left.append(str(arena))
        used_here = pools_of(os.getpid())  # by clients of this process
        left += [str(pool) for pool in sorted(self._pools - used_here) if pool.exists()]
        return left + ([f"port {self._port}"] if port_listens(self._port) else [])

    def processes(self) -> list[psutil.Process]:
        """The live processes of the run, including forked ones, whose command line is one word."""
        return [
            process
            for process in psutil.process_iter(["cmdline", "status"])
            if str(self._folder) in " ".join(process.info["cmdline"] or []).split()
            and process.info["status"] != psutil.STATUS_ZOMBIE
        ]

    def _arena_dir(self) -> Path | None:
        if not (self._folder / "run.json").exists():
            return None
        return Path(RunInfo.read(self._folder).arena_dir)


def port_listens(port: int) -> bool:
    """Whether a program of this machine listens on a TCP port."""
    connections = psutil.net_connections("tcp")
    return any(
        c.status == psutil.CONN_LISTEN and c.laddr and c.laddr.port == port for c in connections
    )
