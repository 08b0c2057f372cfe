"""The supervisor's side of the fork server, and a forked process with the methods of `subprocess.Popen`."""

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.parent_death import adopt_orphans
from hsslam_services.launch.process_table import FORK_SERVER
from hsslam_services.launch.restart_policy import RestartPolicy
from hsslam_services.launch.spawn import (
    NOT_STARTED,
    Process,
    child_environment,
    how_it_ended,
    module_command,
    not_started,
    open_log,
    spawn,
)
from hsslam_services.run.stop_signals import END_SIGNAL

_POLL_S = 0.01
_PATIENCE_S = 120.0  # for a fork server that still imports
_FROZEN_S = 10.0  # for a fork server that has forked before
_END_TIMEOUT_S = 2.0
_KILL_TIMEOUT_S = 5.0
_RETRY_S = 10.0  # if the fork server cannot be started, as without threads


class ForkedProcess:
    """A process started by the fork server: requested (`pid` is None), running or ended.

    `link`: socket on which the new process sends its pid and waits for an answer before it runs. If the
    link closes or no pid comes for `patience_s`, `spawn_fresh` starts the process without the fork server.
    """

    def __init__(
        self,
        link: socket.socket,
        spawn_fresh: Callable[[], subprocess.Popen],
        patience_s: float = _PATIENCE_S,
    ) -> None:
        self._patience_s = patience_s
        self.pid: int | None = None
        self.returncode: int | None = None
        self._link: socket.socket | None = link
        self._spawn_fresh = spawn_fresh
        self._fresh: subprocess.Popen | None = None
        self._asked_s = time.monotonic()
        link.setblocking(False)

    @property
    def is_forked(self) -> bool:
        """Whether the fork server has forked this process."""
        return self.pid is not None and self._fresh is None

    def poll(self) -> int | None:
        """The exit code (negative: killed by this signal); None while it is requested or runs."""
        self._accept()
        if self.returncode is None and self._fresh is not None:
            self.returncode = self._fresh.poll()
        elif self.returncode is None and self.pid is not None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the exit code.

        Raises:
            subprocess.TimeoutExpired: there is none within `timeout`.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired("forked process", timeout or 0.0)
            time.sleep(_POLL_S)
        return code

    def send_signal(self, sig: int) -> None:
        """Send a signal; if the process is only requested and the signal would end it, cancel the request."""
        if self.poll() is not None:
            return
        if self.pid is not None:
            os.kill(self.pid, sig)
        elif sig in (END_SIGNAL, signal.SIGKILL):
            self._close_link()
            self.returncode = -sig

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _accept(self) -> None:
        """Take the pid of the new process if it has come; start the process fresh if it cannot come."""
        if self._link is None:
            return
        try:
            pid = self._link.recv(64)
            if pid:
                self._link.send(b"go")
                self.pid = int(pid)
        except BlockingIOError:
            if time.monotonic() - self._asked_s < self._patience_s:
                return
            pid = b""
        except OSError:  # the process died before our answer
            pid = b""
        self._close_link()
        if not pid:
            try:
                self._fresh = self._spawn_fresh()
            except OSError:
                self.returncode = NOT_STARTED
            else:
                self.pid = self._fresh.pid

    def _close_link(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None


class ForkClient:
    """Starts the processes of a run by forking; without a fork server, as fresh interpreters.

    If the fork server dies, its forks live on as children of this process, and it is started again; after
    a crash loop, processes start without it. `disk` opens the logs.
    """

    def __init__(self, run_dir: Path, disk: DiskWork | None = None) -> None:
        self._disk = disk or DiskWork()
        self.news: list[str] = []  # lines for the operator; the supervisor takes them
        self._run_dir = run_dir
        self._policy = RestartPolicy(first_delay_s=0.0, longest_delay_s=0.0)
        self._process: subprocess.Popen | None = None
        self._socket: socket.socket | None = None
        self._first: ForkedProcess | None = None  # first request to this fork server
        self._started_s = time.monotonic()
        self._retry_s: float | None = None  # the time of the next try
        adopt_orphans()

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the fork server if it does not run; if this fails, processes start without it meanwhile."""
        if self._process is not None:
            return
        try:
            self._start()
        except OSError as error:
            self._close_socket()
            if self._retry_s is None:
                text = f"tried again every {_RETRY_S:g} s; processes start without it meanwhile"
                self.news.append(f"fork server {not_started(error)}: {text}")
            self._retry_s = time.monotonic() + _RETRY_S
        else:
            self._retry_s = None

    def _start(self) -> None:
        self._started_s = time.monotonic()
        self._first = None
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        fd = other.fileno()
        command = module_command(FORK_SERVER, str(self._run_dir))
        with other, open_log(self._run_dir, FORK_SERVER, self._disk) as log:
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
        """Start a process of the run, as `spawn.spawn`; returns before the process exists."""
        self.tick()
        if self._socket is None:
            return spawn(module, run_dir, self._disk)
        with open_log(run_dir, module, self._disk) as log:
            own, other = socket.socketpair()
            with other, contextlib.suppress(OSError):
                # on an error, `other` closes, and the process starts without the fork server
                socket.send_fds(self._socket, [module.encode()], [log.fileno(), other.fileno()])
        patience_s = _FROZEN_S if self._first is not None and self._first.is_forked else _PATIENCE_S
        process = ForkedProcess(own, lambda: spawn(module, run_dir, self._disk), patience_s)
        self._first = self._first or process
        return process

    def tick(self) -> None:
        """Start the fork server again if it has died, or could not be started."""
        if self._retry_s is not None and time.monotonic() >= self._retry_s:
            self.start()
        if self._process is None or self._process.poll() is None:
            return
        how = how_it_ended(self._process.returncode)
        self._close_socket()
        self._process = None
        now_s = time.monotonic()
        if self._policy.failed(now_s, now_s - self._started_s) is None:
            self.news.append(f"fork server {how}: too many restarts, processes start without it")
            return
        self.start()
        self.news.append(f"fork server {how}{': restarted' if self._process is not None else ''}")

    def close(self) -> None:
        """End the fork server; its forks live on."""
        self._close_socket()
        if self._process is not None:
            try:
                self._process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                with contextlib.suppress(subprocess.TimeoutExpired):  # it may hang in a driver
                    self._process.wait(_KILL_TIMEOUT_S)

    def _close_socket(self) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None
