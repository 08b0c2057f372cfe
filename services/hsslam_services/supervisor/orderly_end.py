"""The orderly end of a run: ends processes stage by stage and saves each artefact in a separate step."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hsslam_node.map.store import KeyframeStore
from hsslam_services.arena.arena_folder import pose_count
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.map_state import MapState
from hsslam_services.artefacts.lost_results import (
    LOG_FAILURES,
    POSES_NOT_LOGGED,
    lost_fragments,
    lost_poses,
    unfinished_log,
)
from hsslam_services.disk.disk_work import STEP_S, DiskWork
from hsslam_services.health.run_state import RunState
from hsslam_services.health.status import frames_dropped
from hsslam_services.launch.child import Child
from hsslam_services.launch.process_table import (
    BA_STAGE,
    CAMERA_STAGE,
    EVALUATOR,
    FINAL_MAP_SAVER,
    MAP_STAGE,
    MESH_SAVER,
    MESHER_STAGE,
    RECORDER_STAGE,
    TRACKER_STAGE,
    TRAJECTORY_SAVER,
)
from hsslam_services.run.run_info import RunInfo

_HANGS_MS = 1000.0  # without a turn of its loop, a tracker gives no pose
_LONGEST_DRAIN_S = 5.0  # for the pose of the last frame, which may never come
_LONGEST_CAMERA_S = 3.0  # in real time: it has nothing to finish, but a driver may hang
_KILL_S = 0.5  # of these, a process that hangs in a driver is left to itself
_TRACKER_FIRST_S = 2.0  # in real time; then results are saved while it saves a fragment, or hangs
_LONGEST_RESTART_S = 3.0  # of a process that crashed just before the end
_FINISHES_WORK = ("recorder", "mapper", "global_ba")  # processes that work on when they are stopped


@dataclass
class OrderlyEnd:
    """Ends a run: camera, tracker, trajectories, BA, mapper, map, mesher, mesh, log, evaluation.

    In real time a camera that hangs and a tracker that still saves a fragment do not delay a first save of
    trajectories and map: `docker stop` grants 10 s. What changes after that is saved again.

    `turn()` is one turn of the supervisor's loop; `run_alone(module, is_cancelled)` runs a process to its
    end, or until it is cancelled, and returns "" or the error; `signals()` is the number of stop signals so
    far. After the second signal only the trajectories are still saved, if they are not saved yet.
    `not_saved` has the error of each missing artefact, `given_up` names those that the second signal cut
    short, `not_evaluated` has the error of the evaluation, which is no artefact. `done_s`: when each process
    had ended and each artefact was first saved, s since the begin of the end.
    """

    run: RunInfo
    children: Mapping[str, Child]
    state: RunState
    turn: Callable[[], None]
    run_alone: Callable[[str, Callable[[], bool]], str]
    signals: Callable[[], int]
    report: Callable[[str], None]
    not_saved: dict[str, str] = field(default_factory=dict)
    given_up: list[str] = field(default_factory=list)
    not_evaluated: str = ""
    done_s: dict[str, float] = field(default_factory=dict)
    disk: DiskWork = field(default_factory=DiskWork)
    _begun_s: float = field(default_factory=time.monotonic)
    _saved_poses: tuple[int, int] = (-1, 0)  # `_poses` when the trajectories were last saved

    def to_the_end(self) -> None:
        """Do all steps; if one fails, the others still run."""
        map_state = MapState(self.run.arena_dir)
        map_state.stopped_ns = time.monotonic_ns()
        is_hurried = self._is_hurried
        self._stop(CAMERA_STAGE, _LONGEST_CAMERA_S if is_hurried else math.inf)
        self._drain()
        self._ask_to_end(TRACKER_STAGE, _TRACKER_FIRST_S if is_hurried else math.inf)
        self._save_trajectories(patience=2 if self.state.tracked else 1)
        if any(child.is_alive for child in self._of_stage(TRACKER_STAGE)):
            self._save("map", FINAL_MAP_SAVER)
            self._stop(TRACKER_STAGE)
            self._save_trajectories()  # its fragments may have joined, or have their files now
        self._check_poses()
        self._await_restart("global_ba")
        for name in ("global_ba", "mesher"):  # they end during the first save of the map
            self.children[name].wanted = False
        if is_hurried:
            begun_ns = time.monotonic_ns()
            self._save("map", FINAL_MAP_SAVER)
            map_state.saved_in_ns = time.monotonic_ns() - begun_ns
        self._stop(BA_STAGE)
        self._save_moved_trajectories()
        self._stop(MAP_STAGE)
        self._save_moved_trajectories()
        self._save("map", FINAL_MAP_SAVER)
        self._stop(MESHER_STAGE)
        self._save("mesh", MESH_SAVER)
        self._stop(RECORDER_STAGE)
        self._check_log()
        if self.run.options.evaluate:
            self._evaluate()

    @property
    def _is_hurried(self) -> bool:
        """Whether the end has a time limit, as in real time."""
        return math.isfinite(self.run.options.finish_budget_s)

    def miss(self, artefact: str, why: str) -> None:
        """Note and report that an artefact is not saved."""
        self.not_saved[artefact] = why
        self.report(f"{artefact} not saved: {why}")

    def _ask_to_end(self, stage: int, within_s: float = math.inf) -> None:
        """Wait until the processes of a stage have ended, at most `within_s`."""
        of_stage = self._of_stage(stage)
        for child in of_stage:
            if child.spec.name in _FINISHES_WORK:
                self._await_restart(child.spec.name)
            child.wanted = False
        deadline_s = time.monotonic() + within_s
        while any(child.is_alive for child in of_stage) and self.signals() < 2:
            if time.monotonic() > deadline_s:
                return
            self.turn()
        for child in of_stage:
            self._done(child.spec.name)

    def _stop(self, stage: int, within_s: float = math.inf) -> None:
        """Wait until the processes of a stage have ended; those that take longer are killed."""
        self._ask_to_end(stage, within_s)
        for child in self._of_stage(stage):
            if child.is_alive and self.signals() < 2:
                self.report(f"{child.spec.name} does not end within {within_s:g} s: killed")
            if math.isfinite(within_s):
                child.kill(_KILL_S)
            else:
                child.kill()
            self._done(child.spec.name)

    def _of_stage(self, stage: int) -> list[Child]:
        return [child for child in self.children.values() if child.spec.stop_stage == stage]

    def _drain(self) -> None:
        """Wait for the pose of the last frame that the source has sent."""
        deadline_s = time.monotonic() + _LONGEST_DRAIN_S
        while time.monotonic() < deadline_s and self.signals() < 2:
            self.turn()
            tracker = self.children["tracker"]
            if self.state.source_end is None or not tracker.is_alive:
                return
            hangs = tracker.health is not None and tracker.health.idle_ms > _HANGS_MS
            if hangs and self._is_hurried:
                return
            if self.state.has_answered(self.state.source_end, frames_dropped(self.children)):
                return

    def _await_restart(self, name: str) -> None:
        """Wait for a process with work to finish that crashed just now, for a limited time; report others."""
        child, deadline_s = self.children[name], time.monotonic() + _LONGEST_RESTART_S
        while child.is_restarting and self.signals() < 2:
            if time.monotonic() > deadline_s:
                self.report(f"{name} is not running again yet: its last work may be missing")
                return
            self.turn()

    def _save_trajectories(self, patience: int = 1) -> None:
        # read before, as the saver copies the poses when it begins
        self._saved_poses = self._poses()
        self._save("trajectories", TRAJECTORY_SAVER, patience)

    def _save_moved_trajectories(self) -> None:
        """Save the trajectories again if keyframes have moved or poses have come since they were saved."""
        if self._poses() != self._saved_poses:
            self._save_trajectories()

    def _save(self, artefact: str, module: str, patience: int = 1) -> None:
        """Run a saver; an artefact that failed before, as on a full disk, is no longer missing on success."""
        error = self._step(artefact, module, patience)
        if error:
            self.miss(artefact, error)
        elif error is not None:
            self.not_saved.pop(artefact, None)
        elif artefact not in (*self.done_s, *self.not_saved, *self.given_up):
            self.given_up.append(artefact)
            self.report(f"{artefact} not saved: a second signal ended the run")

    def _evaluate(self) -> None:
        """Run the evaluator; if it fails, `hsslam-eval` can evaluate the saved results later."""
        self.not_evaluated = self._step("evaluation", EVALUATOR) or ""
        if self.not_evaluated:
            again = f"repeat it with hsslam-eval {self.run.path}"
            self.report(f"not evaluated: {self.not_evaluated}; {again}")

    def _step(self, what: str, module: str, patience: int = 1) -> str | None:
        """Run a process to its end; returns "" or the error, None if more than `patience` signals came."""
        if self.signals() > patience:
            return None
        error = self.run_alone(module, lambda: self.signals() > patience)
        if not error:
            self._done(what)
        return None if error and self.signals() > patience else error

    def _done(self, what: str) -> None:
        self.done_s.setdefault(what, round(time.monotonic() - self._begun_s, 3))

    def _check_poses(self) -> None:
        """Miss the poses that the pose log had no memory for, and the fragments that the tracker lost."""
        counted = self.children["tracker"].counted(POSES_NOT_LOGGED)
        self._judge("poses", lambda: lost_poses(self.run.path, counted))
        self._judge("fragments", lambda: lost_fragments(self.run.path))

    def _judge(self, artefact: str, why: Callable[[], str]) -> None:
        """Miss an artefact for the reason that files in the run folder give; also if they cannot be read."""
        try:
            lost = self.disk.do(why, STEP_S, self.turn, lambda: self.signals() > 1)
        except OSError as error:
            lost = f"{self.run.path}: {error.strerror}"
        if lost:
            self.miss(artefact, lost)

    def _check_log(self) -> None:
        """Check by the recorder's result that the log is complete."""
        recorder = self.children["recorder"]
        has_begun = recorder.health is not None or recorder.restarts or recorder.state == "failed"
        if self.signals() > 1 or not has_begun:
            return
        error = ""
        if recorder.state == "failed":
            error = recorder.user_error or "the recorder could not be kept running"
        failures = recorder.counted(LOG_FAILURES)
        self._judge("log", lambda: unfinished_log(self.run.path, error, failures))

    def _poses(self) -> tuple[int, int]:
        """Number of corrections of keyframe poses, -1 without keyframes, and number of poses."""
        arena_dir = Path(self.run.arena_dir)
        try:
            version = KeyframeStore(ArenaView(arena_dir)).pose_version
        except (KeyError, OSError, ValueError):
            version = -1
        return version, pose_count(arena_dir)
