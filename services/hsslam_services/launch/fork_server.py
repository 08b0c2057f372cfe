"""The fork server: imports the modules of a run's processes once, and forks the processes from itself.

Forks share the pages of the imports, so a restart takes 0.1 s instead of seconds. The fork server has one
thread and no connection, so a fork works like a fresh interpreter. The supervisor (a subreaper) becomes the
parent of each fork at once and reaps it; if the supervisor dies, the kernel ends its forks.
"""

import argparse
import contextlib
import gc
import importlib
import os
import select
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import setproctitle

from hsslam_services.launch.parent_death import die_with_parent
from hsslam_services.launch.spawn import module_command
from hsslam_services.run.memory import return_free_memory
from hsslam_services.run.stop_signals import leave_stop_signals_to_supervisor

_PROCESSES = "hsslam_services.processes"
# The camera waits for no other process, so it is forked before the large imports.
_FIRST_IMPORTS = ("hsslam_services.launch.worker", f"{_PROCESSES}.camera", "cv2", "numba")
_IMPORTS = tuple(f"{_PROCESSES}.{name}" for name in ("tracker", "mapper", "global_ba"))
_EARLY = (f"{_PROCESSES}.camera", f"{_PROCESSES}.recorder")
_META_KERNELS = "torch._meta_registrations"


def set_process_title(name: str, command: Sequence[str]) -> None:
    """Show `name` (15 characters) and `command` in `ps` and /proc.

    Raises:
        OSError: the command line does not fit.
    """
    title = " ".join(command)
    setproctitle.setproctitle(title)
    setproctitle.setthreadtitle(name)
    shown = Path("/proc/self/cmdline").read_bytes().rstrip(b"\0")
    if shown != os.fsencode(title):
        raise OSError(f"command line of {len(title)} bytes does not fit into /proc/self/cmdline")


def leave_out_meta_kernels() -> None:
    """Keep the meta kernels of torch's operators out of this process; call it before the import of torch.

    They give the shapes of results without data, for torch.compile and torch.export, which no process of a
    run uses. They take a fifth of the core time of the import, 0.4 s, and 18 MB.
    """
    sys.modules[_META_KERNELS] = ModuleType(_META_KERNELS)


@contextlib.contextmanager
def networkx_left_out() -> Iterator[None]:
    """Keep networkx out of what the block imports; afterwards a plugin can import it.

    trimesh imports it for functions that no process of a run uses. It takes half of the core time of the
    import of trimesh, 0.18 s, in each process that has a mesh.
    """
    modules: dict[str, Any] = sys.modules
    if "networkx" in modules:
        yield
        return
    modules["networkx"] = None  # an import of it fails, and trimesh goes on without it
    try:
        yield
    finally:
        del modules["networkx"]


class _Request(NamedTuple):
    """A request for a process."""

    module: str
    log: int  # file descriptor for its output
    link: int  # file descriptor of a socket to the supervisor

    def is_wanted(self) -> bool:
        """Whether the supervisor still has its end of the link open."""
        poll = select.poll()
        poll.register(self.link, 0)
        return not poll.poll(0)

    def close(self) -> None:
        os.close(self.log)
        os.close(self.link)


def main() -> None:
    """Serve the supervisor at the other end of the socket until it closes the socket or dies."""
    die_with_parent(signal.SIGKILL)
    leave_stop_signals_to_supervisor()  # as its forks do
    parser = argparse.ArgumentParser(prog="hsslam fork server")
    parser.add_argument("--run", required=True, metavar="DIR", help="the run folder")
    parser.add_argument("--socket-to-supervisor", type=int, required=True, metavar="FD")
    args = parser.parse_args()
    with socket.socket(fileno=args.socket_to_supervisor) as supervisor:
        wanted = _serve(supervisor, args.run)
    if wanted is not None:
        _become(wanted, args.run)


def _serve(supervisor: socket.socket, run_dir: str) -> _Request | None:
    """Fork the requested processes. Returns the request in each fork, None in the fork server at its end."""
    gc.disable()  # imports create 0.2 million lasting objects; each collection would visit them
    leave_out_meta_kernels()
    _import(_FIRST_IMPORTS)
    supervisor.setblocking(False)
    waiting: list[_Request] = []
    while isinstance(request := _receive(supervisor), _Request):
        if request.module not in _EARLY:
            waiting.append(request)
        elif _fork(request, waiting):
            return request
    _import(_IMPORTS)
    _load_kernels(Path(run_dir))
    return_free_memory()  # of the imports and the warm start
    gc.freeze()  # a collection in a fork would copy each page that it visits; one here frees 1 MB in 0.2 s
    supervisor.setblocking(True)
    while True:
        request = waiting.pop(0) if waiting else _receive(supervisor)
        if not isinstance(request, _Request):
            return None
        if _fork(request, waiting):
            return request


def _receive(supervisor: socket.socket) -> _Request | None:
    """The next request; None at the end, or if there is none and the socket does not block."""
    try:
        module, fds, _, _ = socket.recv_fds(supervisor, 256, 2)
    except BlockingIOError:
        return None
    return _Request(module.decode(), *fds) if module else None


def _import(modules: tuple[str, ...]) -> None:
    for module in modules:
        importlib.import_module(module)


def _load_kernels(run_dir: Path) -> None:
    """Load the kernels before the first fork; `warm_start` in a fork then has nothing to do."""
    from hsslam_node.warm_start import warm_start
    from hsslam_services.run.run_info import RunInfo

    warm_start(RunInfo.read(run_dir).options.slam)


def _fork(request: _Request, others: list[_Request]) -> bool:
    """Fork twice, so that the supervisor adopts the new process; True in it, False in the fork server."""
    threads = len(list(Path("/proc/self/task").iterdir()))
    if threads > 1:
        sys.exit(f"error: fork server: {threads} threads: expected 1: cannot fork")
    try:
        child = os.fork() if request.is_wanted() else None
    except OSError:  # no more processes: the supervisor finds the link closed, and tries by itself
        child = None
    if child != 0:
        if child is not None:
            os.waitpid(child, 0)
        request.close()
        return False
    go_between = os.getpid()
    if os.fork():
        os._exit(0)
    _wait_for_end(go_between)
    for other in others:
        other.close()
    return True


def _wait_for_end(pid: int) -> None:
    """Wait until the process has ended, so that its children have their new parent."""
    try:
        fd = os.pidfd_open(pid)
    except ProcessLookupError:
        return
    select.select([fd], [], [])
    os.close(fd)


def _become(request: _Request, run_dir: str) -> None:
    """Become the requested process and run its `main`."""
    os.setsid()
    command = module_command(request.module, run_dir)
    set_process_title(f"hsslam-{request.module.rpartition('.')[2]}", command)
    with socket.socket(fileno=request.link) as link:
        link.send(str(os.getpid()).encode())
        if not link.recv(8):
            os._exit(0)  # the supervisor no longer wants it
    os.dup2(request.log, sys.stdout.fileno())
    os.dup2(request.log, sys.stderr.fileno())
    os.close(request.log)
    sys.argv = command[3:]
    with networkx_left_out():
        main = importlib.import_module(request.module).main
    gc.enable()
    main()


if __name__ == "__main__":
    main()
