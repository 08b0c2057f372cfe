"""The table of processes: supervisor, status line, summary and docs iterate over it."""

from dataclasses import dataclass, replace
from typing import Any

from hsslam_node.image_header import LARGEST_PIXELS
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import is_live


@dataclass(frozen=True)
class ProcessSpec:
    """One row: a process that the supervisor keeps running, `python -m <module> --run DIR`.

    `ends_run`: a crash loop of it stops the run.
    `stop_stage`: the processes of a stage stop after those of all earlier stages have ended.
    `restarts_with_map`: it holds state of the map, so a reset of the map restarts it.
    `lockstep_needs`: a lockstep run waits for it in each step, and cannot continue without it.
    `returned_bytes`: freed arrays of this size or more go back to the system, which clears each new array;
    0: the process keeps the memory.
    `reads_source`: it exists only if the run reads frames itself, instead of an external camera's frames.
    `serves_ros2`: it exists only with `--ros2-out`.
    `serves_grid`: it exists only with `--grid`.
    """

    name: str
    module: str
    purpose: str
    nice: int
    stop_stage: int
    ends_run: bool = False
    restarts_with_map: bool = False
    lockstep_needs: bool = False
    returned_bytes: int = 0
    reads_source: bool = False
    serves_ros2: bool = False
    serves_grid: bool = False
    is_late: bool = False  # starts after the others: the first frame does not need it
    may_finish: bool = False  # exit code 0: its work is done; else every exit is a failure
    startup_timeout_s: float = 300.0  # kernels are compiled on the very first run
    health_timeout_s: float = 15.0  # without a heartbeat, after the first
    stall_timeout_s: float = 150.0  # with heartbeats, but without a turn of the main loop
    recording_startup_timeout_s: float | None = None  # instead, if it reads a recording
    rendering_stall_timeout_s: float | None = None  # instead, if frames are tracked by rendering
    stop_timeout_s: float = 20.0  # to end, since the signal or the last turn of the main loop
    first_delay_s: float = 0.5  # before a restart; doubles
    longest_delay_s: float = 10.0

    def exists(self, options: ServeOptions) -> bool:
        """Whether a run with these options has this process."""
        needs = (self.reads_source, self.serves_ros2, self.serves_grid)
        has = (options.has_camera_process, bool(options.ros2_out), options.grid)
        return all(there or not needed for there, needed in zip(has, needs, strict=True))

    def nice_at(self, pace: str) -> int:
        """Its nice value in a run of this pace. A lockstep run waits for the processes that it needs, so they
        do not give way to other programs of the machine."""
        return 0 if pace == "lockstep" and self.is_needed(pace) else self.nice

    def is_needed(self, pace: str) -> bool:
        """Whether a run of this pace cannot continue without this process."""
        return self.ends_run or (self.lockstep_needs and pace == "lockstep")

    def can_refuse(self, pace: str) -> bool:
        """Whether bad input of this process before the first poses ends a run of this pace."""
        return self.is_needed(pace) or self.reads_source


_ARRAY_BYTES = 512 << 10
_IMAGE_BYTES = 4 << 20  # smaller images stay: the system would clear 4 MB for each frame
CAMERA_STAGE, TRACKER_STAGE, BA_STAGE, MAP_STAGE, MESHER_STAGE, RECORDER_STAGE = range(6)


def _row(name: str, purpose: str, **fields: Any) -> ProcessSpec:
    return ProcessSpec(name, f"hsslam_services.processes.{name}", purpose, **fields)


WARM_UP = "hsslam_services.launch.warm_up"
WATCHDOG = "hsslam_services.launch.watchdog"
FORK_SERVER = "hsslam_services.launch.fork_server"
EVALUATOR = "hsslam_services.processes.evaluator"
MAP_LOADER = "hsslam_services.processes.map_loader"
MAP_SAVER = "hsslam_services.processes.map_saver"
TRAJECTORY_SAVER = "hsslam_services.processes.trajectory_saver"
FINAL_MAP_SAVER = "hsslam_services.processes.final_map_saver"
MESH_SAVER = "hsslam_services.processes.mesh_saver"
_WAITS_FOR_ROS2 = 2  # `--ros2.timeout-s`: for a router, and for images
_OPENING_S = 60.0  # of a live camera, beside these waits
_READING_TIMEOUT_S = 4 * 3600.0  # of a bag or log of a terabyte, which is read once
ONE_SHOT_TIMEOUT_S = {  # processes that end by themselves
    WARM_UP: 600.0,
    MAP_LOADER: _READING_TIMEOUT_S,
    MAP_SAVER: 300.0,
    FINAL_MAP_SAVER: 600.0,
    MESH_SAVER: 3600.0,  # it shows its progress; a second signal ends it
    EVALUATOR: 3600.0,
    TRAJECTORY_SAVER: 60.0,  # and some more for each pose
}

_SAVED_POSES_PER_S = 10_000  # on a slow disk; an hour has 108 000 at 30 Hz


def one_shot_timeout_s(module: str, poses: int) -> float:
    """The time limit of a process that ends by itself, s; `poses`: number of poses of the run."""
    saving_s = poses / _SAVED_POSES_PER_S if module == TRAJECTORY_SAVER else 0.0
    return ONE_SHOT_TIMEOUT_S[module] + saving_s


PROCESSES: tuple[ProcessSpec, ...] = (
    _row(
        "tracker",
        "poses and keyframes",
        nice=0,
        stop_stage=TRACKER_STAGE,
        ends_run=True,
        restarts_with_map=True,
        stall_timeout_s=10.0,  # a frame takes 10 ms, relocalisation a second
        rendering_stall_timeout_s=150.0,  # a frame takes seconds, more on a busy core
    ),
    _row(
        "mapper",
        "steps the scene model",
        nice=5,
        stop_stage=MAP_STAGE,
        ends_run=True,
        restarts_with_map=True,
    ),
    _row(
        "recorder",
        "writes run.mcap and feeds rerun",
        nice=8,
        stop_stage=RECORDER_STAGE,
        returned_bytes=_IMAGE_BYTES,
        stop_timeout_s=120.0,  # recovers earlier parts and finishes its files
    ),
    _row(
        "camera",
        "publishes the source",
        nice=0,
        stop_stage=CAMERA_STAGE,
        reads_source=True,
        may_finish=True,
        recording_startup_timeout_s=_READING_TIMEOUT_S,
        stall_timeout_s=60.0,  # it never waits longer than a second
    ),
    _row(
        "global_ba",
        "refines keyframe poses",
        nice=14,
        stop_stage=BA_STAGE,  # before the mapper, which holds the map for its last iterations
        is_late=True,
        restarts_with_map=True,
        lockstep_needs=True,
        returned_bytes=_ARRAY_BYTES,
        stop_timeout_s=60.0,  # it finishes its round
    ),
    _row(
        "mesher",
        "extracts the mesh",
        nice=19,
        stop_stage=MESHER_STAGE,
        returned_bytes=_ARRAY_BYTES,
        is_late=True,
        restarts_with_map=True,
    ),
    _row(
        "distances",
        "publishes free space and distances around the camera",
        nice=6,
        stop_stage=MESHER_STAGE,
        is_late=True,
        restarts_with_map=True,
        serves_grid=True,
    ),
    _row(
        "ros2_out",
        "publishes the run to ROS 2",
        nice=8,
        stop_stage=MESHER_STAGE,
        is_late=True,
        restarts_with_map=True,
        serves_ros2=True,
    ),
)


def environment_of_threads(threads: int) -> dict[str, str]:
    """Environment variables that limit the threads of numeric libraries and the images that OpenCV reads; set
    them before any import."""
    names = ("OMP", "OPENBLAS", "MKL", "NUMBA")
    return {
        **{f"{name}_NUM_THREADS": str(threads) for name in names},
        "OPENCV_FOR_THREADS_NUM": str(threads),
        # for formats whose headers we do not read
        "OPENCV_IO_MAX_IMAGE_PIXELS": str(LARGEST_PIXELS),
    }


def process_number(name: str) -> int:
    """Row of a process in the table, from 1; 0: not in the table."""
    return next((k for k, spec in enumerate(PROCESSES, 1) if spec.name == name), 0)


def processes_of(options: ServeOptions) -> list[ProcessSpec]:
    """The processes of a run with these options, with their time limits in it."""
    specs = [spec for spec in PROCESSES if spec.exists(options)]
    if is_live(options.source):
        specs = [_of_live(spec, options) for spec in specs]
    else:
        specs = [_of_recording(spec) for spec in specs]
    if options.slam.tracker.method == "alignment":
        return specs
    return [
        replace(spec, stall_timeout_s=spec.rendering_stall_timeout_s or spec.stall_timeout_s)
        for spec in specs
    ]


def _of_live(spec: ProcessSpec, options: ServeOptions) -> ProcessSpec:
    """The process in a run of a live camera: while it starts, it may wait for a router and for images."""
    if not spec.reads_source:
        return spec
    waits_s = _WAITS_FOR_ROS2 * options.ros2.timeout_s + _OPENING_S
    return replace(spec, startup_timeout_s=max(spec.startup_timeout_s, waits_s))


def _of_recording(spec: ProcessSpec) -> ProcessSpec:
    """The process in a run that reads a recording."""
    startup_s = spec.recording_startup_timeout_s or spec.startup_timeout_s
    return replace(spec, startup_timeout_s=startup_s)
