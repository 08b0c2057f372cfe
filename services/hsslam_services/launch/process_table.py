"""The table of processes: supervisor, status line, summary and docs iterate over it."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ProcessSpec:
    """One row: a process that the supervisor keeps running, `python -m <module> --run DIR`.

    `ends_run`: giving up on it in a crash loop stops the run with exit code 1.
    `stop_stage`: all processes of a stage have ended before those of the next stage are told to end.
    `restarts_with_map`: it keeps state of the map, so a reset replaces it.
    `lockstep_needs`: a lockstep run waits for it in each step, and cannot continue without it.
    `reads_source`: it exists only if frames are read here, not published by an outside camera.
    """

    name: str
    module: str
    purpose: str
    nice: int
    stop_stage: int
    ends_run: bool = False
    restarts_with_map: bool = False
    lockstep_needs: bool = False
    reads_source: bool = False
    is_late: bool = False  # started when the others take work: the first frame does not need it
    may_finish: bool = False  # exit code 0 means that its work is done, not that it failed
    startup_timeout_s: float = 300.0  # kernels are compiled on the very first run
    health_timeout_s: float = 15.0  # without a heartbeat; armed by the first
    stall_timeout_s: float = 150.0  # heartbeats, but the main loop has not come round
    stop_timeout_s: float = 20.0
    first_delay_s: float = 0.5  # before a restart; doubles
    longest_delay_s: float = 10.0

    def is_needed(self, pace: str) -> bool:
        """Whether the run cannot continue without it."""
        return self.ends_run or (self.lockstep_needs and pace == "lockstep")


CAMERA_STAGE, TRACKER_STAGE, MAP_STAGE, RECORDER_STAGE = 1, 2, 3, 4  # order of the stop


def _row(name: str, purpose: str, **fields: Any) -> ProcessSpec:
    return ProcessSpec(name, f"hsslam_services.processes.{name}", purpose, **fields)


WARM_UP = "hsslam_services.launch.warm_up"
WATCHDOG = "hsslam_services.launch.watchdog"
FORK_SERVER = "hsslam_services.launch.fork_server"
SAVER = "hsslam_services.processes.saver"
EVALUATOR = "hsslam_services.processes.evaluator"
MAP_LOADER = "hsslam_services.processes.map_loader"
MAP_SAVER = "hsslam_services.processes.map_saver"
TRAJECTORY_SAVER = "hsslam_services.processes.trajectory_saver"
ONE_SHOT_TIMEOUT_S = {  # processes that end by themselves
    WARM_UP: 600.0,
    MAP_LOADER: 300.0,
    MAP_SAVER: 300.0,
    SAVER: 300.0,
    EVALUATOR: 300.0,
    TRAJECTORY_SAVER: 60.0,
}

PROCESSES: tuple[ProcessSpec, ...] = (
    _row(
        "tracker",
        "poses and keyframes",
        nice=0,
        stop_stage=TRACKER_STAGE,
        ends_run=True,
        restarts_with_map=True,
    ),
    _row(
        "mapper",
        "steps the scene model",
        nice=5,
        stop_stage=MAP_STAGE,
        ends_run=True,
        restarts_with_map=True,
        stop_timeout_s=120.0,  # its last iterations
    ),
    _row("recorder", "writes run.mcap and feeds rerun", nice=8, stop_stage=RECORDER_STAGE),
    _row(
        "camera",
        "publishes the source",
        nice=0,
        stop_stage=CAMERA_STAGE,
        reads_source=True,
        may_finish=True,
    ),
    _row(
        "global_ba",
        "refines keyframe poses",
        nice=14,
        stop_stage=MAP_STAGE,
        is_late=True,
        restarts_with_map=True,
        lockstep_needs=True,
    ),
    _row(
        "mesher",
        "extracts the mesh",
        nice=19,
        stop_stage=MAP_STAGE,
        is_late=True,
        restarts_with_map=True,
    ),
)


def environment_of_threads(threads: int) -> dict[str, str]:
    """Variables that keep numeric libraries to so many threads; set before any import."""
    names = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    return {
        **{f"{name}_NUM_THREADS": str(threads) for name in names},
        "OPENCV_FOR_THREADS_NUM": str(threads),
    }
