"""`hsslam-render`: images of a saved map along a trajectory.

What a user can ask of `hsslam-render`: one frozen dataclass; every field is an option.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
import tyro

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.map_renderer import MapRenderer
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.presets import REALTIME
from hsslam_services.commands.cli import exit_code, parse_options, terminal_progress
from hsslam_services.commands.maps.saved_map import SavedMap


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


_PROG = "hsslam-render"
_CODECS = {".mp4": "mp4v", ".avi": "MJPG"}


def main(args: Sequence[str] | None = None) -> None:
    """Exit code 0: written; 1: interrupted; 2: bad input."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _render(parse_options(RenderOptions, _PROG, given))):
        sys.exit(code)


def _render(options: RenderOptions) -> None:
    poses = read_tum(options.expect_inputs()).T_world_cam[:: options.every]
    if len(poses) == 0:
        raise UserError(f"--trajectory {options.trajectory}: no poses: expected one or more")
    saved = SavedMap(Path(options.map), options.device)
    camera = _camera(saved.camera, options)
    sampling = saved.checkpoint.sampling or REALTIME.sampling
    renderer = MapRenderer(saved.checkpoint, SlamConfig(sampling=sampling))
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {options.out}: {error.strerror}: expected a folder") from None
    video = _open_video(options, camera)
    try:
        with terminal_progress() as progress:
            for k in progress.track(range(len(poses)), description="images"):
                depth_m = saved.rays.depth(camera, poses[k])
                color, _ = renderer.render(depth_m, camera, poses[k])
                image = cv2.cvtColor((255 * color + 0.5).astype(np.uint8), cv2.COLOR_RGB2BGR)
                path = options.out / f"{k:06d}.png"
                if not cv2.imwrite(str(path), image):
                    raise UserError(f"{path}: cannot be written: expected room and permission")
                if video is not None:
                    video.write(image)
    finally:
        if video is not None:
            video.release()
    size = f"{camera.width_px} x {camera.height_px} px"
    also = f", {options.video}" if options.video else ""
    print(f"{options.out}: {len(poses)} images, {size}{also}")


def _camera(camera: Camera, options: RenderOptions) -> Camera:
    if options.fov_deg is not None:
        focal_px = camera.width_px / 2 / np.tan(np.deg2rad(options.fov_deg) / 2)
        camera = replace(camera, fx=float(focal_px), fy=float(focal_px))
    return camera if options.downscale == 1 else camera.scaled(1 / options.downscale)


def _open_video(options: RenderOptions, camera: Camera) -> cv2.VideoWriter | None:
    if options.video is None:
        return None
    codec = cv2.VideoWriter.fourcc(*_CODECS[options.video.suffix.lower()])
    size = (camera.width_px, camera.height_px)
    video = cv2.VideoWriter(str(options.video), codec, options.rate_hz, size)
    if not video.isOpened():
        raise UserError(f"--video {options.video}: OpenCV cannot write it: expected .avi or none")
    return video


if __name__ == "__main__":
    main()
