"""The supervisor's end of the fork server, and a forked process as `subprocess.Popen` would show it."""

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

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
_FROZEN_S = 10.0  # for one that has forked before
_END_TIMEOUT_S = 2.0


class ForkedProcess:
    """A process started by the fork server: requested (`pid` is None), running, ended.

    `link`: the new process sends its pid and waits for an answer before it runs. If the link closes
    without a word, or none comes for `patience_s`, `plainly` starts the process without the fork server.
    """

    def __init__(
        self,
        link: socket.socket,
        plainly: Callable[[], subprocess.Popen],
        patience_s: float = _PATIENCE_S,
    ) -> None:
        self._patience_s = patience_s
        self.pid: int | None = None
        self.returncode: int | None = None
        self._link: socket.socket | None = link
        self._plainly = plainly
        self._plain: subprocess.Popen | None = None
        self._asked_s = time.monotonic()
        link.setblocking(False)

    @property
    def is_forked(self) -> bool:
        """Whether the fork server has forked it."""
        return self.pid is not None and self._plain is None

    def poll(self) -> int | None:
        """The exit code (negative: the signal that killed it), None while it runs or is awaited."""
        self._meet()
        if self.returncode is None and self._plain is not None:
            self.returncode = self._plain.poll()
        elif self.returncode is None and self.pid is not None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """The exit code, when there is one.

        Raises:
            subprocess.TimeoutExpired: there is none yet.
        """
        deadline = None if timeout is None else time.monotonic() + timeout
        while (code := self.poll()) is None:
            if deadline is not None and time.monotonic() > deadline:
                raise subprocess.TimeoutExpired("forked process", timeout or 0.0)
            time.sleep(_POLL_S)
        return code

    def send_signal(self, sig: int) -> None:
        """Send a signal; one that is not born yet and would die of it is called off."""
        if self.poll() is not None:
            return
        if self.pid is not None:
            os.kill(self.pid, sig)
        elif sig in (END_SIGNAL, signal.SIGKILL):
            self._part()
            self.returncode = -sig

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)

    def _meet(self) -> None:
        """Take the newborn's word, if it has come."""
        if self._link is None:
            return
        try:
            word = self._link.recv(64)
            if word:
                self._link.send(b"go")
                self.pid = int(word)
        except BlockingIOError:
            if time.monotonic() - self._asked_s < self._patience_s:
                return
            word = b""
        except OSError:  # it died between its word and our answer
            word = b""
        self._part()
        if not word:
            try:
                self._plain = self._plainly()
            except OSError:
                self.returncode = NOT_STARTED
            else:
                self.pid = self._plain.pid

    def _part(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None


class ForkClient:
    """Starts processes of a run by forking, once `start` was called; what it cannot do is done plainly.

    If the fork server dies, its forks live on (they are this process's children), and it is started
    again; after a crash loop every process is a fresh interpreter.
    """

    def __init__(self, run_dir: Path) -> None:
        self.news: list[str] = []  # what the operator should read; the supervisor takes it
        self._run_dir = run_dir
        self._policy = RestartPolicy(first_delay_s=0.0, longest_delay_s=0.0)
        self._process: subprocess.Popen | None = None
        self._socket: socket.socket | None = None
        self._first: ForkedProcess | None = None  # that this fork server was asked for
        self._started_s = time.monotonic()
        adopt_orphans()

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    def start(self) -> None:
        """Start the fork server, if it does not run; if the system refuses, processes start without it."""
        if self._process is not None:
            return
        try:
            self._start()
        except OSError as error:
            self._close_socket()
            self.news.append(f"fork server {not_started(error)}: processes start without it")

    def _start(self) -> None:
        self._started_s = time.monotonic()
        self._first = None
        self._socket, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        fd = other.fileno()
        command = module_command(FORK_SERVER, str(self._run_dir))
        with other, open_log(self._run_dir, FORK_SERVER) as log:
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
        with open_log(run_dir, module) as log:
            own, other = socket.socketpair()
            with other, contextlib.suppress(OSError):
                # on an error `other` closes: the process is then started without the fork server
                socket.send_fds(self._socket, [module.encode()], [log.fileno(), other.fileno()])
        patience_s = _FROZEN_S if self._first is not None and self._first.is_forked else _PATIENCE_S
        process = ForkedProcess(own, lambda: spawn(module, run_dir), patience_s)
        self._first = self._first or process
        return process

    def tick(self) -> None:
        """Start the fork server again if it has died."""
        if self._process is None or self._process.poll() is None:
            return
        how = how_it_ended(self._process.returncode)
        self._close_socket()
        self._process = None
        now_s = time.monotonic()
        if self._policy.failed(now_s, now_s - self._started_s) is None:
            self.news.append(f"fork server {how}: too many restarts, processes start without it")
            return
        self.news.append(f"fork server {how}: restarted")
        self.start()

    def close(self) -> None:
        """End the fork server; its forks live on."""
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
