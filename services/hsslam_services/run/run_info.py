"""`run.json` in the run folder: names, folders and options of a run, for all its processes."""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from hsslam_node.durable_file import write_durably
from hsslam_node.errors import MORE_SHARED_MEMORY, UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.topics import ROS_ROUTER
from hsslam_services.run.options import ServeOptions

RUN_FILE = "run.json"


@dataclass(frozen=True)
class RunInfo:
    """Names, folders and options of a run. The supervisor writes it before any process starts."""

    run_id: str
    run_dir: str
    arena_dir: str
    endpoint: str  # zenoh, as tcp/127.0.0.1:7447
    robot: str
    supervisor_pid: int
    started_ns: int  # wall clock
    options: ServeOptions

    @property
    def path(self) -> Path:
        """The run folder."""
        return Path(self.run_dir)

    @property
    def camera_arena(self) -> Path | None:
        """The arena, where the camera process stores its number; None if another program sends the frames."""
        return Path(self.arena_dir) if self.options.has_camera_process else None

    @property
    def ros_endpoint(self) -> str:
        """Router of the ROS nodes: --ros2.connect, else the run's own on port 7447, else another on 7447."""
        own = self.endpoint if self.options.has_usual_port else ROS_ROUTER
        return self.options.ros2.connect or own

    @property
    def source_options(self) -> SourceOptions:
        """The options of the source alone, with the router of ROS nodes filled in."""
        options = self.options.source_options
        return replace(options, ros2=replace(options.ros2, connect=self.ros_endpoint))

    def write(self) -> None:
        """Write run.json and config.toml, each in one step; OSError if the folder is not writable."""
        from hsslam_services.run.config_file import (  # only the writer needs TOML
            CONFIG_FILE,
            config_text,
        )

        write_durably(self.path / RUN_FILE, msgspec.json.format(msgspec.json.encode(self)))
        write_durably(self.path / CONFIG_FILE, config_text(self.options).encode())

    def restore(self) -> None:
        """Make the run folder and its run.json again if they are gone.

        Raises:
            OSError: the folder cannot be written.
        """
        self.path.mkdir(parents=True, exist_ok=True)
        if not (self.path / RUN_FILE).exists():
            self.write()

    def write_into_arena(self) -> None:
        """Write a copy into the arena: a rescue and `hsslam-ctl` then work without the run folder.

        Raises:
            UserError: the shared memory is full.
        """
        try:
            write_atomically(Path(self.arena_dir) / RUN_FILE, msgspec.json.encode(self))
        except OSError as error:
            raise UserError(f"{self.arena_dir}: {error.strerror}: {MORE_SHARED_MEMORY}") from None

    @staticmethod
    def read(run_dir: Path) -> "RunInfo":
        """The run of this folder.

        Raises:
            UserError: there is no run.json, or one of another version.
        """
        path = run_dir / RUN_FILE
        try:
            return msgspec.json.decode(path.read_bytes(), type=RunInfo)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}: expected run.json of a run") from None
        except msgspec.MsgspecError as error:
            raise UserError(f"{path}: {error}: expected run.json of a run") from None


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that a reader finds the old content or the new, never a part.

    It does not wait for the disk, so a power cut may lose both; use it for files that running processes read.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    temporary.write_bytes(data)
    temporary.replace(path)
