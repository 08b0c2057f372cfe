"""Runs the viewer of the rerun wheel as a child process on loopback."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import rerun_cli

from hsslam_node.errors import UserError
from hsslam_services.launch.parent_death import die_with_parent
from hsslam_services.run.memory import RETURN_FREED_MEMORY_OF_RERUN

_PORT = 9876
_WEB_PORT = 9090
_PROBE_EVERY_S = 0.05
_SERVER_SHARE = 0.25  # of the memory of a native viewer; for viewers that connect later
_MEMORY_GB = {"spawn": 0.5, "web": 0.15}  # default limits


class ViewerProcess:
    """The native viewer ("spawn") or the server of the web viewer ("web"); `url` takes the data.

    The native viewer stays open when the run ends; the web server does not. `page` is the address for a
    browser, None for the native viewer. `memory_gb`: memory limit, GB (None: 0.5 for the native viewer, 0.15
    for the server); beyond it the viewer drops the oldest data.

    Raises:
        UserError: the viewer cannot be started.
    """

    def __init__(self, kind: Literal["spawn", "web"], memory_gb: float | None = None) -> None:
        self._held: list[socket.socket] = []  # claim the ports until this process ends
        port = self._free_port(_PORT)
        self._ports = [port]
        self.kind = kind
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        self.page: str | None = None
        command = [_executable(), "--bind", "127.0.0.1", "--port", str(port)]
        if kind == "web":
            web_port = self._free_port(_WEB_PORT)
            self._ports.append(web_port)
            query = self.url.replace(":", "%3A").replace("/", "%2F").replace("+", "%2B")
            self.page = f"http://127.0.0.1:{web_port}/?url={query}"
            command += ["--serve-web", "--web-viewer-port", str(web_port)]
        else:
            command += ["--expect-data-soon"]
        command += _memory_limits(kind, _MEMORY_GB[kind] if memory_gb is None else memory_gb)
        self._command = command
        environment = os.environ | RETURN_FREED_MEMORY_OF_RERUN | {"RUST_LOG": "error"}
        try:
            self._process = subprocess.Popen(
                command,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,  # stderr goes to the log of this process
                start_new_session=True,
                preexec_fn=_die_with_parent if kind == "web" else None,
            )
        except OSError as error:
            raise UserError(f"--viewer {kind}: cannot start {command[0]}: {error}") from None

    @property
    def command(self) -> list[str]:
        """The program and its options."""
        return self._command

    @property
    def pid(self) -> int:
        """Process id of the viewer, or of the web server."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None: it runs."""
        return self._process.poll()

    def has_ended(self) -> bool:
        """Whether the viewer was closed."""
        return self.exit_code is not None

    def wait_until_it_listens(self, should_stop: Callable[[], bool]) -> bool:
        """Wait until all ports take connections; False if the viewer ends or `should_stop` before.

        rerun's client gives up if an address takes no connection for 7 s.
        """
        while not (self.has_ended() or should_stop()):
            if all(map(_takes_connections, self._ports)):
                return True
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_PROBE_EVERY_S)
        return False

    def _free_port(self, wanted: int) -> int:
        """`wanted` if it is free on loopback, else any free port; not that of a viewer that still starts."""
        for port in (wanted, 0, 0, 0):
            with socket.socket() as probe:
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                # another program has the port, or another run its name; the kernel frees it with that run
                with contextlib.suppress(OSError):
                    probe.bind(("127.0.0.1", port))
                    found = probe.getsockname()[1]
                    name = socket.socket(socket.AF_UNIX)
                    self._held.append(name)
                    name.bind(f"\0hsslam-viewer-port-{found}")
                    return found
        raise UserError("viewer: no free port on 127.0.0.1")

    def close(self) -> None:
        """End the web server; leave the native viewer to the user."""
        if self.kind == "web" and not self.has_ended():
            self._process.terminate()
            try:
                self._process.wait(timeout=2.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        for name in self._held:
            name.close()


def _memory_limits(kind: Literal["spawn", "web"], memory_gb: float) -> list[str]:
    """Memory options of rerun: the native viewer counts the buffer of its built-in server, too."""
    server_mb = round(1000 * memory_gb * (1.0 if kind == "web" else _SERVER_SHARE))
    viewer = ["--memory-limit", f"{round(1000 * memory_gb)}MB"] if kind == "spawn" else []
    return [*viewer, "--server-memory-limit", f"{server_mb}MB"]


def _takes_connections(port: int) -> bool:
    with socket.socket() as probe:
        if probe.connect_ex(("127.0.0.1", port)) != 0:
            return False
        return probe.getsockname() != probe.getpeername()  # a socket can connect to itself


def _executable() -> str:
    # the console script is a wrapper; killing it would not end the real viewer
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return str(Path(rerun_cli.__file__).parent / name)


def _die_with_parent() -> None:
    die_with_parent(signal.SIGKILL)
