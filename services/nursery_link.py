"""The supervisor's end of the nursery."""

import contextlib
import ctypes
import socket
import subprocess
import time
from pathlib import Path

from hsslam_node.services.forked_process import ForkedProcess
from hsslam_node.services.process_title import module_command
from hsslam_node.services.restart_policy import RestartPolicy
from hsslam_node.services.spawn import Process, child_environment, how_it_ended, open_log, spawn

_MODULE = "hsslam_node.services.nursery"
_PR_SET_CHILD_SUBREAPER = 36
_END_TIMEOUT_S = 2.0


class NurseryLink:
    """Starts processes of a run by forking, once `start` was called; what it cannot do is done plainly.

    If the nursery dies, its forks live on (they are this process's children), and it is started
    again; after a crash loop every process is a fresh interpreter.
    """

    def __init__(self, run_dir: Path) -> None:
        self.news: list[str] = []  # what the operator should read; the supervisor takes it
        self._run_dir = run_dir
        self._policy = RestartPolicy(first_delay_s=0.0, longest_delay_s=0.0)
        self._process: subprocess.Popen | None = None
        self._socket: socket.socket | None = None
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the nursery, if it does not run."""
        if self._process is not None:
            return
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        fd = other.fileno()
        command = module_command(_MODULE, str(self._run_dir))
        with other, open_log(self._run_dir, _MODULE) as log:
            self._process = subprocess.Popen(
                [*command, "--socket-to-supervisor", str(fd)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=child_environment(),
                pass_fds=[fd],
                start_new_session=True,
            )

    def spawn(self, module: str, run_dir: Path) -> Process:
        """Start a process of the run, as `spawn.spawn` does; returns before it is born."""
        self.tick()
        if self._socket is None:
            return spawn(module, run_dir)
        own, other = socket.socketpair()
        with open_log(run_dir, module) as log, other, contextlib.suppress(OSError):
            # on an error `other` closes: the process is then started without the nursery
            socket.send_fds(self._socket, [module.encode()], [log.fileno(), other.fileno()])
        return ForkedProcess(own, lambda: spawn(module, run_dir))

    def tick(self) -> None:
        """Start the nursery again if it has died."""
        if self._process is None or self._process.poll() is None:
            return
        how = how_it_ended(self._process.returncode)
        self._close_socket()
        self._process = None
        if self._policy.failed(time.monotonic()) is None:
            self.news.append(f"nursery {how}: too many restarts, processes start without it")
            return
        self.news.append(f"nursery {how}: restarted")
        self.start()

    def close(self) -> None:
        """End the nursery; its forks live on."""
        self._close_socket()
        if self._process is not None:
            try:
                self._process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _close_socket(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
