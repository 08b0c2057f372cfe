"""The supervisor: router, arena and processes of one run, from the start to the orderly end.

Subscribes: in/end, out/correction, out/keyframe, out/map, out/pose, sys/health, sys/event
Publishes: sys/event, sys/hold, sys/stop
Arena: reads pose_log; writes map_state
"""

import contextlib
import shutil
import signal
import traceback
from collections.abc import Callable, Collection, Mapping
from typing import TypeVar

from hsslam_node.durable_file import remove_partial_files
from hsslam_node.errors import UserError, one_line
from hsslam_node.kernels.cache_folder import has_run_kernels
from hsslam_services.arena.arena_folder import ArenaFolder, pose_count
from hsslam_services.arena.unsaved_marker import ARENA_ARTEFACTS, mark_unsaved
from hsslam_services.bus.bus import Bus
from hsslam_services.camera.open_source import check_source_exists
from hsslam_services.disk.disk_work import STEP_S, DiskWork
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.resilient_stream import say_at_end
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import hear_stop_signals
from hsslam_services.supervisor.descriptors import allow_descriptors
from hsslam_services.supervisor.kept_watchdog import KeptWatchdog
from hsslam_services.supervisor.preparation import Prepared, prepare
from hsslam_services.supervisor.run_loop import RunLoop

_T = TypeVar("_T")


class Supervisor:
    """Runs until the source ends, a signal comes, or a failure ends the run; `run` returns the exit code.

    The first SIGINT, SIGTERM or SIGHUP stops in order, the second SIGINT or SIGTERM at once.
    `was_interrupted`: whether a signal came before `run` hears them.
    """

    def __init__(
        self, options: ServeOptions, was_interrupted: Callable[[], bool] = lambda: False
    ) -> None:
        self._options = options
        self._was_interrupted = was_interrupted
        self._signals = 0

    def run(self) -> ExitCode:
        """Start everything, keep it running, stop in order.

        If this process crashes or is killed during the run, the watchdog saves the results in the arena. The
        exit code after a crash makes a service manager restart the service.

        Raises:
            UserError: the run cannot start.
            KeyboardInterrupt: a signal came before the run.
        """
        check_source_exists(self._options)  # before signals are caught: it may start a download
        hear_stop_signals(self._signalled)
        # a parent that ignores it would hide the ends of forked processes
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        if self._was_interrupted():
            raise KeyboardInterrupt
        allow_descriptors()
        prepared = prepare(self._options, lambda: self._signals > 0)
        try:
            return self._run(prepared)
        except UserError:
            raise
        except Exception as error:  # of any kind, also without memory or room on the disk
            how = f"the supervisor crashed ({one_line(error)})"
            to = f"its watchdog saves the results to {prepared.info.run_dir}"
            say_at_end(f"{traceback.format_exc()}error: {how}: {to}")
            return ExitCode.NOT_SAVED

    def _run(self, prepared: Prepared) -> ExitCode:
        info, arena = prepared.info, prepared.arena
        disk = DiskWork()
        fork_client = ForkClient(info.path, disk)
        watchdog: KeptWatchdog | None = None
        is_in_order = False
        try:
            if has_run_kernels(info.options.grid):
                fork_client.start()
            watchdog = KeptWatchdog(info.path, arena.path, disk=disk)
            with Bus(info.endpoint, info.robot, "supervisor") as bus:
                run = RunLoop(prepared, bus, fork_client, watchdog, lambda: self._signals, disk)
                try:
                    code = run.to_the_end()
                except UserError:
                    run.kill_all()
                    raise
                except BaseException:
                    # the processes end by themselves when this one is gone, with their results
                    run.drain()
                    raise
                run.kill_all()
                with contextlib.suppress(
                    OSError
                ):  # files of savers that were killed cost only room
                    self._do(disk, lambda: remove_partial_files(info.path))
        except UserError:
            self._remove(arena, disk)
            with contextlib.suppress(TimeoutError):  # else the next run does it
                self._do(disk, prepared.give_back)
            is_in_order = True
            raise
        else:
            self._free(arena, info, run.not_saved, run.given_up, disk)
            if not run.has_begun_to_replace:
                self._keep_replaced(prepared, disk)
            is_in_order = True
            return code
        finally:
            fork_client.close()
            prepared.close()
            arena.let_go()
            if is_in_order and watchdog is not None:
                watchdog.expect_end()
            # else it saves the results in the arena, and outlives this process

    def _free(
        self,
        arena: ArenaFolder,
        info: RunInfo,
        not_saved: Mapping[str, str],
        given_up: Collection[str],
        disk: DiskWork,
    ) -> None:
        """Remove the arena, unless it holds results that could not be saved; then also those given up."""
        if not any(name in not_saved for name in ARENA_ARTEFACTS) or not pose_count(arena.path):
            self._remove(arena, disk)
            return
        kept = [name for name in ARENA_ARTEFACTS if name in not_saved or name in given_up]
        with contextlib.suppress(OSError):  # the memory is full; the folder says enough
            mark_unsaved(arena.path, info.path, kept)
        text = f"{', '.join(kept)} not saved, kept in memory: hsslam-serve rescue {arena.path}"
        say_at_end(text)

    def _remove(self, arena: ArenaFolder, disk: DiskWork) -> None:
        """Remove the arena; if the disk does not answer, its arrays there stay, but no memory is lost."""
        try:
            self._do(disk, arena.remove)
        except TimeoutError:
            shutil.rmtree(arena.path, ignore_errors=True)

    def _keep_replaced(self, prepared: Prepared, disk: DiskWork) -> None:
        """Keep the results of the previous run if this run ended before it had poses."""
        with contextlib.suppress(OSError):  # else the next run in this folder keeps them
            if name := self._do(disk, prepared.replaced.keep):
                text = f"this run has no poses: the results of the previous run are in {name}"
                say_at_end(f"{prepared.info.run_dir}: {text}")

    def _do(self, disk: DiskWork, action: Callable[[], _T]) -> _T:
        """Wait for file work at the end of the run; the second signal shortens the wait.

        Raises:
            TimeoutError: the disk does not answer.
        """
        return disk.do(action, STEP_S, is_hurried=lambda: self._signals > 1)

    def _signalled(self, count: int) -> None:
        self._signals = count
