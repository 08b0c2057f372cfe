"""The options of `hsslam-serve`: one frozen dataclass, one field an option."""

import math
import re
import sys
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.config.tracking import NEW_MAP_AFTER_S
from hsslam_node.distance.voxel_grid import VOXEL_M, layers_between
from hsslam_node.environment import DISPLAYS
from hsslam_node.errors import UserError
from hsslam_node.geometry.robot_frames import RobotFrames, level_frame, mounting
from hsslam_node.odometry.noise import USUAL_NOISE
from hsslam_node.sources.options.camera import CameraOptions, RealsenseOptions
from hsslam_node.sources.options.limits import expect_at_least, expect_range
from hsslam_node.sources.options.source import RecordOptions, SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.options.topics import BagOptions, Ros2Options
from hsslam_services.run.exit_code import exit_code_help
from hsslam_services.run.source_table import (
    comes_over_bus,
    needs_port,
    refuse_ignored_options,
    sources_help,
    speaks_ros2,
)
from hsslam_services.run.viewer_url import is_address, viewer_url

_ZENOH_PORT = 7447
_FINISH_S = 10.0  # in realtime: what `docker stop` allows
_LEAST_LOG_GB = 0.01  # a part has a quarter of what is kept
_MOST_HEIGHT_M = 2.3  # of the window of the grid
_VIEWERS = ("auto", "none", "web", "spawn")


@dataclass(frozen=True)
class ServeOptions:
    """Dense RGB-D SLAM as a service: tracks a camera, builds a mesh, logs the run.

    Examples:
      hsslam-serve --source tum:my_recording --viewer web --out runs/mine
      hsslam-serve --config runs/mine --seed 1     repeat a run with another seed
      hsslam-serve warm-up                         compile the CPU kernels before the first run
      hsslam-serve rescue runs/mine                save what a run could not (exit code 4)

    Ctrl-C ends a run and saves everything.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    EPILOGUE: ClassVar = f"{sources_help()}\n\n{exit_code_help()}"
    BASIC: ClassVar = (
        *("source", "config", "preset", "pace", "device", "viewer", "out", "maps", "map"),
        *("localise_only", "seed", "noise", "rate_hz", "start", "stride", "frames"),
        *(
            "downscale",
            "memory_gb",
            "log_color",
            "log_keep",
            "evaluate",
            "robot",
            "zenoh_port",
            "bind",
        ),
        *("security", "metrics_port", "camera", "record", "ros2.color", "ros2.depth", "ros2_out"),
        "grid",
        *("ros2.domain", "ros2.connect", "realsense.serial"),
    )
    VALUES: ClassVar = {
        "source": "SOURCE",
        "config": "FILE...",
        "viewer": "auto|none|web|spawn|connect:URL",
        "out": "FOLDER",
        "mask": "FILE|FOLDER",
        "maps": "FOLDER",
        "map": "NAME|FILE|FOLDER",
        "log_keep": "GB",
        "security": "FOLDER",
        "robot": "NAME",
        "bind": "ADDRESS",
        "ros2.color": "TOPIC",
        "ros2.depth": "TOPIC",
        "ros2.info": "TOPIC",
        "ros2.odometry": "TOPIC",
        "ros2.imu": "TOPIC",
        "ros2.connect": "ENDPOINT",
        "bag.color": "TOPIC",
        "bag.depth": "TOPIC",
        "bag.info": "TOPIC",
        "bag.odometry": "TOPIC",
        "bag.imu": "TOPIC",
        "ros2_out": "NAMESPACE",
        "ros2_frame_prefix": "TEXT",
        "realsense.serial": "NUMBER",
    }

    source: str = "synth:room"
    """Source of the frames, see Sources."""
    config: tuple[str, ...] = ()
    """Options from a TOML file, a run folder, or camera:NAME; the last file wins."""
    preset: Literal["realtime", "paper", "eslam", "co-slam"] = "realtime"
    """Defaults of all --slam options: for two CPU cores, or as published."""
    pace: Literal["realtime", "lockstep"] = "realtime"
    """realtime drops late frames; lockstep uses all and is reproducible."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the map is computed; auto: a GPU that works, in lockstep the CPU."""
    viewer: str = "auto"
    """Live viewer; auto is spawn if there is a display, else none."""
    memory_gb: float = 1.05
    """Limit of shared memory, GB; near it fewer keyframes are kept."""
    viewer_memory_gb: float | None = None
    """Memory limit of the viewer, GB; it drops the oldest data beyond it (none: spawn 0.5, web 0.15)."""
    out: str = ""
    """Run folder for all results (empty: runs/SOURCE-TIME)."""
    maps: str = "maps"
    """Folder of saved maps, NAME.safetensors each."""
    map: str = ""
    """Saved map to load: a NAME in --maps, a file or a run folder (empty: none)."""
    localise_only: bool = False
    """With --map: track the camera and leave the map as it is."""
    new_map_after_s: float = NEW_MAP_AFTER_S
    """Start a new map after this long without a pose, 1 s or more; it joins the old map later (0: never)."""
    seed: int = 0
    """Seed of all random numbers."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to a source without noise."""
    exposure: Literal["none", "drift"] = "none"
    """Brightness drift and jumps of 20 to 30 % added to the images."""
    rate_hz: float | None = None
    """Rate of the sensor clock, Hz; lockstep has none (none: that of the source)."""
    start: int = 0
    """Skip the first N frames of the source."""
    stride: int = 1
    """Use every N-th frame of the source."""
    frames: int | None = None
    """Use at most N frames (none: all)."""
    to_and_fro: int = 1
    """Play the frames of a recording N times, every second time backwards."""
    hold_at: int = 0
    """Number of the frame that --hold-frames repeats."""
    hold_frames: int = 0
    """Repeat that frame N times, like a camera that stands still."""
    cover_at: int = 0
    """Number of the first frame that --cover-frames covers."""
    cover_frames: int = 0
    """Cover the lens for N frames: black, and without depth."""
    mask: str = ""
    """Mask image, or folder of one per frame, sized as before --downscale; black: no depth (empty: none)."""
    downscale: int = 1
    """Divide the image width and height by N."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    bag: BagOptions = field(default_factory=BagOptions)
    ros2_out: str = ""
    """Publish to ROS 2 below this namespace, as /hsslam (empty: off)."""
    ros2_tf: bool = True
    """With --ros2-out: publish /tf and /tf_static; off if other nodes do."""
    ros2_frame_prefix: str = ""
    """With --ros2-out: prefix of all frame names, as robot1/ (empty: none)."""
    base_T_camera: tuple[float, ...] = ()
    """Pose of the camera in base_link: x y z qx qy qz qw, m, optical axes (none: looking ahead)."""
    odometry_noise: float = USUAL_NOISE
    """Standard deviation of the robot's odometry: m after 1 m, and rad after 1 rad."""
    camera_T_imu: tuple[float, ...] = ()
    """Pose of the IMU in the camera's optical frame: x y z qx qy qz qw, m (none: from /tf_static of ROS, else
    the camera's centre and axes)."""
    grid: bool = False
    """Publish free cells and distances around the camera, up to ten times a second."""
    grid_from_height_m: float = 0.15
    """With --grid: lowest height of obstacles above the floor, m."""
    grid_to_height_m: float = 1.6
    """With --grid: highest height of obstacles above the floor, m."""
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)
    log_color: Literal["jpeg", "png"] = "jpeg"
    """Colour in the log; png is lossless, the log 3 times as large."""
    log_part_mb: int = 1024
    """Start a new log file (run.1.mcap, ...) after N MiB (0: one file)."""
    log_keep: float = 0.0
    """Keep the newest N GB of the log (0: all)."""
    evaluate: bool = True
    """Compare with ground truth at the end of the run, if the source has it."""
    finish_s: float | None = None
    """Time limit from the stop until the map is saved, s (none: 10; in lockstep no limit)."""
    robot: str = "robot"
    """Name of this robot in the zenoh keys hsslam/NAME/..."""
    zenoh_port: int | None = None
    """TCP port for other programs (none: 7447 if one is needed, else closed)."""
    bind: str = ""
    """Address of the zenoh port (empty: loopback); 0.0.0.0 accepts other machines."""
    security: str = ""
    """Folder of the router's certificate; clients then need one, too (empty: open)."""
    metrics_port: int | None = None
    """Loopback TCP port of /metrics (Prometheus) and /healthz (none: off)."""
    slam: SlamConfig = field(default_factory=SlamConfig)

    def __post_init__(self) -> None:
        if is_address(self.viewer):
            viewer_url(self.viewer)
        elif self.viewer not in _VIEWERS:
            expected = "auto, none, web, spawn or connect:URL"
            raise UserError(f"--viewer {self.viewer}: expected {expected}")
        expect_at_least("memory-gb", self.memory_gb, 0.1, "GB")
        if self.viewer_memory_gb is not None:
            expect_at_least("viewer-memory-gb", self.viewer_memory_gb, 0.1, "GB")
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self.robot):
            raise UserError(f"--robot {self.robot!r}: expected letters, digits, - and _")
        if self.zenoh_port is not None:
            expect_range("zenoh-port", self.zenoh_port, 1, 65535)
        if self.metrics_port is not None:
            expect_range("metrics-port", self.metrics_port, 1, 65535)
        if self.rate_hz is not None:
            expect_range("rate-hz", self.rate_hz, 0.01, 10_000)
        if self.localise_only and not self.map:
            raise UserError("--localise-only: expected --map NAME too")
        if not (math.isfinite(self.new_map_after_s) and self.new_map_after_s >= 0):
            raise UserError(
                f"--new-map-after-s {self.new_map_after_s:g}: expected seconds, or 0 for never"
            )
        if self.map and self.slam.tracker.method != "alignment":
            raise UserError(
                f"--map {self.map}: --slam.tracker.method {self.slam.tracker.method} cannot relocalise "
                "in a saved map: expected alignment, as in --preset realtime"
            )
        if self.ros2_out and not re.fullmatch(r"(/[A-Za-z_]\w*)+", self.ros2_out):
            raise UserError(f"--ros2-out {self.ros2_out!r}: expected a namespace such as /hsslam")
        if not re.fullmatch(r"(\w+(/\w+)*/?)?", self.ros2_frame_prefix):
            raise UserError(
                f"--ros2-frame-prefix {self.ros2_frame_prefix!r}: expected a prefix such as robot1/"
            )
        RobotFrames.mounted(self.base_T_camera)
        mounting("--camera-T-imu", self.camera_T_imu)
        low_m, high_m = self.grid_from_height_m, self.grid_to_height_m
        heights = f"--grid-from-height-m {low_m:g} --grid-to-height-m {high_m:g}"
        if not 0 <= low_m < high_m <= _MOST_HEIGHT_M:
            raise UserError(f"{heights}: expected 0 <= from < to <= {_MOST_HEIGHT_M} m")
        first, end = layers_between(low_m, high_m, VOXEL_M)
        if first == end:
            raise UserError(f"{heights}: expected a multiple of {VOXEL_M} m between them")
        expect_at_least("seed", self.seed, 0)
        expect_at_least("start", self.start, 0)
        expect_at_least("stride", self.stride, 1)
        if self.frames is not None:
            expect_at_least("frames", self.frames, 1)
        if self.finish_s is not None:
            expect_at_least("finish-s", self.finish_s, 0, "seconds")
        if self.log_part_mb < 0:
            raise UserError(f"--log-part-mb {self.log_part_mb}: expected MiB, or 0 for one file")
        if not (
            math.isfinite(self.log_keep) and (self.log_keep == 0 or self.log_keep >= _LEAST_LOG_GB)
        ):
            raise UserError(
                f"--log-keep {self.log_keep:g}: expected at least {_LEAST_LOG_GB:g} GB, or 0 to keep all"
            )
        expect_range("to-and-fro", self.to_and_fro, 1, 10_000)
        expect_at_least("hold-at", self.hold_at, 0)
        if self.hold_at and not self.hold_frames:
            raise UserError(f"--hold-at {self.hold_at}: expected with --hold-frames")
        expect_range("hold-frames", self.hold_frames, 0, 10_000_000)
        expect_at_least("cover-at", self.cover_at, 0)
        if self.cover_at and not self.cover_frames:
            raise UserError(f"--cover-at {self.cover_at}: expected with --cover-frames")
        expect_range("cover-frames", self.cover_frames, 0, 10_000_000)
        expect_range("odometry-noise", self.odometry_noise, 1e-4, 1)
        expect_range("downscale", self.downscale, 1, 16)
        if not self.has_camera_process:
            refuse_ignored_options(self.source, self.source_options)

    @property
    def source_options(self) -> SourceOptions:
        """The options of the source alone, for `open_source` and `open_ground_truth`."""
        return SourceOptions.among(self)

    @property
    def T_level_world(self) -> np.ndarray | None:
        """Transform [4, 4] to the frame `map` of the robot; None without --base-T-camera and --ros2-out."""
        return level_frame(self.base_T_camera, in_ros=bool(self.ros2_out))

    @property
    def has_other_rate(self) -> bool:
        """Whether speeds are by the wall clock, as frames come at another rate than the source's stamps."""
        return self.rate_hz is not None and not speaks_ros2(self.source)

    @property
    def has_camera_process(self) -> bool:
        """Whether the service reads the frames itself; false if another program publishes them."""
        return not comes_over_bus(self.source)

    @property
    def outside_place(self) -> str:
        """ADDRESS:PORT for other programs; empty if the run opens no port."""
        asked = self.zenoh_port or self.bind or self.security or self.ros2_out
        asked = asked or needs_port(self.source)
        port = _ZENOH_PORT if self.zenoh_port is None else self.zenoh_port
        return f"{self.bind or '127.0.0.1'}:{port}" if asked else ""

    @property
    def has_usual_port(self) -> bool:
        """Whether the port of the run, if it opens one, is 7447, the default of zenoh."""
        return self.zenoh_port in (None, _ZENOH_PORT)

    @property
    def ros_domain(self) -> int | None:
        """The domain of the ROS nodes that may use the router; None if the run does not use ROS."""
        has_ros_camera = needs_port(self.source) and self.has_camera_process
        return self.ros2.domain if has_ros_camera or self.ros2_out else None

    @property
    def finish_budget_s(self) -> float:
        """Seconds from the stop to the map on disk; infinite in lockstep, whose result is reproducible."""
        if self.finish_s is not None:
            return self.finish_s
        return _FINISH_S if self.pace == "realtime" else math.inf

    @property
    def resolved_viewer(self) -> str:
        """`viewer`, with auto replaced by spawn if there is a display and by none otherwise."""
        if self.viewer != "auto":
            return self.viewer
        has_display = sys.platform == "darwin" or any(display.value() for display in DISPLAYS)
        return "spawn" if has_display else "none"
