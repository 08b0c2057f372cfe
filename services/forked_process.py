"""A process that the nursery forks, as its supervisor sees it: like a `subprocess.Popen`."""

import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable

_POLL_S = 0.01
_PATIENCE_S = 120.0  # for a nursery that still imports; one that is frozen is not waited for


class ForkedProcess:
    """Asked for, then born, then ended; `pid` is None until it is born.

    `link`: the new process says its pid there, and runs when it is answered. If the link closes
    without a word the nursery is gone, and `plainly` starts the process without it.
    """

    def __init__(self, link: socket.socket, plainly: Callable[[], subprocess.Popen]) -> None:
        self.pid: int | None = None
        self.returncode: int | None = None
        self._link: socket.socket | None = link
        self._plainly = plainly
        self._plain: subprocess.Popen | None = None
        self._asked_s = time.monotonic()
        link.setblocking(False)

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
        elif sig in (signal.SIGTERM, signal.SIGKILL):
            self._part()
            self.returncode = -sig

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

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
            if time.monotonic() - self._asked_s < _PATIENCE_S:
                return
            word = b""
        except OSError:  # it died between its word and our answer
            word = b""
        self._part()
        if not word:
            self._plain = self._plainly()
            self.pid = self._plain.pid

    def _part(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None
