"""What a user can ask of `hsslam-render`: one frozen dataclass; every field is an option."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from hsslam_node.errors import UserError


@dataclass(frozen=True)
class RenderOptions:
    """Images of a saved map from any poses, without the service.

    $ hsslam-render map.safetensors --trajectory poses.txt --video flight.mp4

    One PNG a pose, 000000.png and so on, drawn by the field itself; black where the map has no surface.

    Exit code 0: written; 1: interrupted; 2: bad input, told in one line.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    map: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="MAP")] = ""
    """File of a saved map, as a run leaves it: map.safetensors."""
    trajectory: Path | None = None
    """Poses in TUM format (s, m, unit quaternion; camera to world) in the world of the map."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("views")
    """Folder of the images; made if it is not there."""
    every: int = 1
    """Draw every n-th pose."""
    downscale: float = 1.0
    """Make images so many times smaller along each side than those of the map's camera."""
    fov_deg: float | None = None
    """Horizontal field of view, degrees (none: that of the map's camera)."""
    video: Path | None = None
    """Video of the images as well: .mp4 or .avi."""
    rate_hz: float = 30.0
    """Images per second of the video, Hz."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where surfaces are searched (auto: an NVIDIA GPU if one works, else the CPU)."""

    def __post_init__(self) -> None:
        if self.every < 1:
            raise UserError(f"--every {self.every}: expected 1 or more")
        if not 1 <= self.downscale <= 16:
            raise UserError(f"--downscale {self.downscale}: expected 1 to 16")
        if self.fov_deg is not None and not 1 <= self.fov_deg <= 170:
            raise UserError(f"--fov-deg {self.fov_deg}: expected 1 to 170 degrees")
        if not (math.isfinite(self.rate_hz) and 0 < self.rate_hz <= 240):
            raise UserError(f"--rate-hz {self.rate_hz}: expected above 0, 240 at most")
        if self.video is not None and self.video.suffix.lower() not in (".mp4", ".avi"):
            raise UserError(f"--video {self.video}: expected a file .mp4 or .avi")

    def expect_inputs(self) -> Path:
        """The trajectory; UserError where map or trajectory are not named."""
        if not self.map:
            raise UserError("no map: expected hsslam-render MAP --trajectory FILE")
        if self.trajectory is None:
            raise UserError("--trajectory: missing: expected poses in TUM format")
        return self.trajectory
