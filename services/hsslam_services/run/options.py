"""What a user can ask of `hsslam-serve`: one frozen dataclass; every field is an option."""

import math
import os
import re
import sys
from dataclasses import dataclass, field
from typing import Literal

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.sources.options import (
    CameraOptions,
    RealsenseOptions,
    RecordOptions,
    Ros2Options,
    SourceOptions,
    SynthOptions,
)

ZENOH_SOURCE = "zenoh:"
_VIEWERS = ("auto", "none", "web", "spawn")


@dataclass(frozen=True)
class ServeOptions:
    """Dense RGB-D SLAM as a service: tracks a camera, grows a mesh, logs everything.

    Sources: synth:room | synth:apartment | synth:corridor | synth:person | tum:fr1/desk (fetched if it is
    not on disk) | tum:FOLDER | replica:FOLDER | scannet:FOLDER or FILE.sens | record:FOLDER (plain images
    in color/ and depth/) | ros2:/camera (a camera of ROS 2, over rmw_zenoh) | realsense (on USB) | mcap:FILE
    or mcap:RUN (the frames of a log) | zenoh: (frames that somebody else publishes).

    $ hsslam-serve --source tum:my_recording --viewer web --out runs/mine
    $ hsslam-serve warm-up

    Ctrl-C ends a run in order, with everything saved. warm-up compiles the CPU kernels ahead of the first
    run.

    Exit code 0: all done; 1: a process could not be kept running; 2: bad input, told in one line.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    source: str = "synth:room"
    """Where frames come from."""
    pace: Literal["realtime", "lockstep"] = "realtime"
    """realtime: the sensor's clock rules, late frames are dropped; lockstep: every frame is tracked
    and mapped before the next is sent, which is reproducible bit for bit."""
    preset: Literal["realtime", "paper", "eslam", "co-slam"] = "realtime"
    """Defaults of all --slam options: for 30 Hz on two CPU cores; the paper's; those of the methods it is
    compared with."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the scene model is computed (auto: an NVIDIA GPU if one works, else the CPU; the reason is
    told)."""
    viewer: str = "auto"
    """auto | none | web | spawn | connect:URL (auto: spawn where there is a display, else none)."""
    viewer_memory_gb: float = 2.0
    """Memory of the viewer that is started (spawn), or of the server of the web viewer (web), GB; beyond it
    the oldest data goes."""
    out: str = ""
    """Folder of the results (empty: runs/SOURCE-TIME)."""
    maps: str = "maps"
    """Folder of saved maps, NAME.safetensors each."""
    map: str = ""
    """Saved map to go on in, wherever the camera is: its NAME in the maps folder, or a file (empty: a new
    map)."""
    localise_only: bool = False
    """With --map: only tell where the camera is in it; the map stays as it is."""
    seed: int = 0
    """Seed of everything random."""
    noise: Literal["none", "kinect"] = "none"
    """Depth noise added to an exact source."""
    exposure: Literal["none", "drift"] = "none"
    """Changes of brightness added to the images: smooth drift and jumps of 20 to 30 %."""
    rate_hz: float | None = None
    """Frames per second of the sensor clock, Hz (none: the source's own)."""
    start: int = 0
    """Leave out so many frames at the beginning of the source."""
    stride: int = 1
    """Use every n-th frame of the source."""
    frames: int | None = None
    """Use at most so many frames (none: all)."""
    downscale: int = 1
    """Make images so many times smaller along each side."""
    synth: SynthOptions = field(default_factory=SynthOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    record: RecordOptions = field(default_factory=RecordOptions)
    ros2: Ros2Options = field(default_factory=Ros2Options)
    realsense: RealsenseOptions = field(default_factory=RealsenseOptions)
    log_color: Literal["jpeg", "png"] = "jpeg"
    """Colour in the log: jpeg (quality 90), or png (lossless, 7 times as large: replays give the same
    poses)."""
    log_part_mb: int | None = None
    """Begin a new part of the log (run.1.mcap, ...) after so many MB (none: one file)."""
    evaluate: bool = True
    """Compare with ground truth at the end, where the source has it."""
    robot: str = "robot"
    """Name of this robot in the zenoh keys hsslam/ROBOT/..."""
    zenoh_port: int = 7447
    """TCP port that the zenoh router listens on."""
    bind: str = "127.0.0.1"
    """Address that the zenoh router listens on; other than loopback lets other machines in."""
    security: str = ""
    """Folder of the router's certificate, from hsslam-certs: the port then takes TLS with a certificate
    of the same CA only, and each may do what its role may (empty: the port is open)."""
    metrics_port: int | None = None
    """TCP port on loopback for /metrics (Prometheus) and /healthz (none: off)."""
    slam: SlamConfig = field(default_factory=SlamConfig)

    def __post_init__(self) -> None:
        if self.viewer not in _VIEWERS and not re.fullmatch(r"connect:\S+", self.viewer):
            expected = "auto, none, web, spawn or connect:URL"
            raise UserError(f"--viewer {self.viewer}: expected {expected}")
        if not (math.isfinite(self.viewer_memory_gb) and self.viewer_memory_gb >= 0.1):
            expected = "expected GB, 0.1 or more"
            raise UserError(f"--viewer-memory-gb {self.viewer_memory_gb}: {expected}")
        if not re.fullmatch(r"[A-Za-z0-9_-]+", self.robot):
            raise UserError(f"--robot {self.robot!r}: expected letters, digits, - and _")
        if not 1 <= self.zenoh_port <= 65535:
            raise UserError(f"--zenoh-port {self.zenoh_port}: expected 1 to 65535")
        if self.metrics_port is not None and not 1 <= self.metrics_port <= 65535:
            raise UserError(f"--metrics-port {self.metrics_port}: expected 1 to 65535")
        if self.rate_hz is not None and not (math.isfinite(self.rate_hz) and self.rate_hz > 0):
            raise UserError(f"--rate-hz {self.rate_hz}: expected a number above 0")
        if self.localise_only and not self.map:
            raise UserError("--localise-only: expected with --map NAME")
        if self.map and self.slam.tracker.method != "alignment":
            raise UserError(
                f"--map {self.map}: --slam.tracker.method {self.slam.tracker.method} cannot find its "
                "place in a saved map: expected alignment, as in preset realtime"
            )
        if self.seed < 0:
            raise UserError(f"--seed {self.seed}: expected 0 or more")
        if self.start < 0:
            raise UserError(f"--start {self.start}: expected 0 or more")
        if self.stride < 1:
            raise UserError(f"--stride {self.stride}: expected 1 or more")
        if self.frames is not None and self.frames < 1:
            raise UserError(f"--frames {self.frames}: expected 1 or more")
        if self.log_part_mb is not None and self.log_part_mb < 1:
            raise UserError(f"--log-part-mb {self.log_part_mb}: expected 1 or more")
        if not 1 <= self.downscale <= 16:
            raise UserError(f"--downscale {self.downscale}: expected 1 to 16")

    @property
    def source_options(self) -> SourceOptions:
        """What `open_source` and `open_ground_truth` take."""
        return SourceOptions(
            noise=self.noise,
            exposure=self.exposure,
            seed=self.seed,
            start=self.start,
            stride=self.stride,
            frames=self.frames,
            downscale=self.downscale,
            synth=self.synth,
            camera=self.camera,
            record=self.record,
            ros2=self.ros2,
            realsense=self.realsense,
        )

    @property
    def has_camera_process(self) -> bool:
        """Whether frames are read here, not published by somebody else."""
        return self.source != ZENOH_SOURCE

    @property
    def resolved_viewer(self) -> str:
        """`viewer` with auto decided: spawn where there is a display, else none."""
        if self.viewer != "auto":
            return self.viewer
        has_display = sys.platform == "darwin" or any(
            os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
        )
        return "spawn" if has_display else "none"
