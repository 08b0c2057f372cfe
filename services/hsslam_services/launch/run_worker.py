"""The `main` of a process, from its command line to its exit."""

import argparse
import atexit
import contextlib
import faulthandler
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from hsslam_node.device.gpu_memory import gpu_memory_errors
from hsslam_node.errors import OutOfMemoryError, UserError, one_line
from hsslam_services.arena.process_registry import enter_process
from hsslam_services.launch.parent_death import die_with_parent
from hsslam_services.launch.process_table import PROCESSES
from hsslam_services.launch.worker import Worker
from hsslam_services.run.memory import return_large_arrays
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL, leave_stop_signals_to_supervisor


def run_worker(name: str, loop: Callable[[Worker], None]) -> NoReturn:
    """Read `--run DIR` from the command line, run `loop(worker)` and exit.

    Exit code 0: the loop has returned; 2, with one line: `UserError`; 1, with one line and a traceback in the
    process's log: another exception.
    """
    faulthandler.enable()
    die_with_parent(END_SIGNAL)
    leave_stop_signals_to_supervisor()
    parser = argparse.ArgumentParser(prog=f"hsslam {name}")
    parser.add_argument("--run", type=Path, required=True, metavar="DIR", help="the run folder")
    run_dir = parser.parse_args().run
    spec = next((spec for spec in PROCESSES if spec.name == name), None)  # None: a one-shot process
    if spec is None:
        return_large_arrays()
    elif spec.returned_bytes:
        return_large_arrays(spec.returned_bytes)
    code = 0
    try:
        run = RunInfo.read(run_dir)
        _give_way(spec.nice_at(run.options.pace) if spec else 0)
        not_entered = _enter(run, name)
        if os.getppid() != run.supervisor_pid:
            raise UserError(f"{name}: parent is not supervisor {run.supervisor_pid}")
        with Worker(name, run) as worker:
            try:
                if not_entered:
                    worker.event("warning", not_entered)
                with gpu_memory_errors():
                    loop(worker)
            except UserError as error:
                worker.event("error", str(error))
                raise
            except Exception as error:  # of a plugin, or a fault of ours
                with contextlib.suppress(Exception):
                    worker.event("error", f"{one_line(error)}; the traceback is in its log")
                raise
    except UserError as error:
        print(f"error: {error}", file=sys.stderr, flush=True)
        with contextlib.suppress(OSError):  # the run folder may be the problem
            lacks_memory = isinstance(error, OutOfMemoryError)
            write_result(run_dir, name, ProcessResult(error=str(error), lacks_memory=lacks_memory))
        code = 2
    # not in `except`: the traceback holds the objects of the loop, whose pools of threads end with them
    _end(code)


def _end(code: int) -> NoReturn:
    """Exit as Python does, but leave the memory to the kernel.

    Python would free the objects of the imports one by one, which delays the end of the run by 0.5 s.
    """
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError):  # a full disk costs only lines of the log
            stream.flush()
    os._exit(code)


def _enter(run: RunInfo, name: str) -> str:
    """Enter this process in its arena; returns a warning if this fails, else ""."""
    try:
        enter_process(Path(run.arena_dir), name)
    except OSError as error:  # no room: the run goes on
        return f"{run.arena_dir}: {error.strerror}: the watchdog cannot end the {name}"
    return ""


def _give_way(nice: int) -> None:
    """Set the nice value of this process. If Linux schedules by session (autogroup), only the nice value of a
    session counts; set it too if this process leads its session."""
    os.nice(nice)
    if os.getsid(0) != os.getpid():
        return
    with contextlib.suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(nice), encoding="utf-8")
