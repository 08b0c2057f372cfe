"""The request `reset`: ends all processes that hold state of the map, and restarts them without it."""

import contextlib
import subprocess
import time
from collections.abc import Generator, Mapping
from functools import partial
from pathlib import Path

from hsslam_node.map.pose_log import PoseLog
from hsslam_proto import topics
from hsslam_proto.request_messages import Done
from hsslam_proto.run_messages import Event
from hsslam_services.arena.arena_folder import pose_count, remove_arrays
from hsslam_services.arena.map_state import MapState
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.requests import PendingRequest
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.health.run_state import RunState
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import TRAJECTORY_SAVER, one_shot_timeout_s
from hsslam_services.launch.spawn import Spawn, last_error, not_started, process_name
from hsslam_services.requests.pause_and_mode import CameraPause
from hsslam_services.run.process_result import ProcessResult, clear_result, read_result
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import update_summary

_PATIENCE_S = 5.0  # for an orderly end; the reset discards their work anyway
_KILL_TIMEOUT_S = 1.0
_DISK_S = 10.0  # for file work, while no process tracks
_Steps = Generator[None, None, None]  # each `yield` ends a turn of the supervisor's loop


class MapReset:
    """Ends a map epoch and begins the next, one turn of the supervisor's loop at a time.

    Steps: pause the camera; end the processes that hold state of the map; write the trajectories so far, as
    each map epoch has its own files; remove keyframes and parameters from the arena, but keep the pose log;
    start the processes again; resume the camera. If the trajectories cannot be written, the processes go on
    with the old map.
    """

    def __init__(
        self,
        bus: Bus,
        run: RunInfo,
        spawn: Spawn,
        pause: CameraPause,
        disk: DiskWork | None = None,
    ) -> None:
        self._disk = disk or DiskWork()
        self._run = run
        self._spawn = spawn
        self._pause = pause
        self._mode = MapState(run.arena_dir)
        self._events = bus.publisher(topics.EVENT)
        self._asked: list[PendingRequest] = []
        self._children: list[Child] = []  # that hold state of the map
        self._steps: _Steps | None = None

    @property
    def map_epoch(self) -> int:
        """Number of the current map."""
        return self._mode.map_epoch

    @property
    def is_busy(self) -> bool:
        """Whether a reset is in progress."""
        return self._steps is not None

    def ask(
        self,
        asked: PendingRequest,
        *,
        has_map: bool,
        state: RunState,
        children: Mapping[str, Child],
    ) -> None:
        """Start a reset; refused if the mode is localise-only or there is no map.

        A request during a reset gets the same answer: a busy zenoh sends a request twice.
        """
        if self.is_busy:
            self._asked.append(asked)
        elif self._mode.localise_only:
            asked.refuse(
                "not_now", "reset: the mode is localise-only: expected mapping (set-mode mapping)"
            )
        elif not has_map:
            asked.refuse("not_now", "reset: there is no map yet: expected a first keyframe")
        else:
            self._children = [c for c in children.values() if c.spec.restarts_with_map]
            self._asked.append(asked)
            self._steps = self._reset(state, self._children)

    def tick(self) -> None:
        """Do the next step; never blocks."""
        if self._steps is None:
            return
        try:
            next(self._steps)
        except StopIteration:
            self._steps = None
        except Exception as error:  # of any kind: else no process tracks or maps again
            self._steps = None
            self._go_on()
            self._pause.release()
            self._answer(f"{getattr(error, 'strerror', None) or error}; the map stays")

    def close(self) -> None:
        """End a reset in progress."""
        if self._steps is not None:
            self._steps.close()

    def _reset(self, state: RunState, children: list[Child]) -> _Steps:
        self._pause.suspend()
        self._mode.is_given_up = True
        for child in children:
            child.wanted = False
        yield from _ended(children)
        yield from self._sum_up("tracker")  # what it lost, before the next one begins
        error = yield from self._save_trajectories()
        if not error:
            remove_arrays(Path(self._run.arena_dir), PoseLog.owns)
            self._mode.map_epoch += 1
            state.forget_map()
            self._report(f"map discarded by a client: map epoch {self.map_epoch} begins")
        self._go_on()
        needed = [child for child in children if child.spec.ends_run]
        while not all(child.state == "running" for child in needed):
            if any(child.state == "failed" for child in needed):
                self._answer("tracker or mapper cannot be kept running")
                return
            yield
        self._pause.release()
        self._answer(f"{error}; the map stays" if error else "")

    def _go_on(self) -> None:
        """Start the processes of the map again."""
        self._mode.is_given_up = False
        for child in self._children:
            child.renew()
            child.wanted = not child.spec.is_late

    def _save_trajectories(self) -> Generator[None, None, str]:
        """Run the process that writes them; returns "" or the error."""
        name = process_name(TRAJECTORY_SAVER)
        try:
            yield from self._disk.steps(lambda: clear_result(self._run.path, name), _DISK_S)
            process = self._spawn(TRAJECTORY_SAVER, self._run.path)
        except OSError as error:
            return f"{name} {not_started(error)}"
        timeout_s = one_shot_timeout_s(TRAJECTORY_SAVER, pose_count(Path(self._run.arena_dir)))
        deadline_s = time.monotonic() + timeout_s
        code = None
        try:
            while (code := process.poll()) is None:
                if time.monotonic() > deadline_s:
                    return f"trajectories not written after {timeout_s:.0f} s"
                yield
        finally:
            if code is None:
                process.kill()
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(_KILL_TIMEOUT_S)
        result = yield from self._sum_up(name)
        return last_error(result, self._run.path, TRAJECTORY_SAVER) if code else ""

    def _sum_up(self, name: str) -> Generator[None, None, ProcessResult]:
        """Add the result of a process to the summary, unless the disk is full; returns it."""
        result = ProcessResult()
        with contextlib.suppress(OSError):  # only the trajectories matter
            result = yield from self._disk.steps(lambda: read_result(self._run.path, name), _DISK_S)
            add = partial(update_summary, self._run.path, result.summary)
            yield from self._disk.steps(add, _DISK_S)
        return result

    def _answer(self, error: str) -> None:
        asked, self._asked = self._asked, []
        for each in asked:
            if error:
                each.refuse("failed", f"reset: {error}")
            else:
                each.answer(Done(text=f"map discarded: map epoch {self.map_epoch} begins"))

    def _report(self, text: str) -> None:
        self._events.put(Event.now("control", "warning", text))


def _ended(children: list[Child]) -> _Steps:
    """Wait until all have ended; kill those that take too long."""
    deadline_s = time.monotonic() + _PATIENCE_S
    while any(child.is_alive for child in children):
        if time.monotonic() > deadline_s:
            for child in children:
                child.kill()
        yield
