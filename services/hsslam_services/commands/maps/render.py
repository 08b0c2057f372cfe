"""`hsslam-render`: renders images of a saved map along a trajectory."""

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar, Literal

import cv2
import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.commands.cli import exit_code, parse_options, terminal_progress
from hsslam_services.commands.maps.surface import out_file
from hsslam_services.commands.maps.whole_space import map_file
from hsslam_services.commands.output_files import as_utf8, expect_file

_PROG = "hsslam-render"
_CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
_IMAGE = re.compile(r"\d{6,}\.png")


@dataclass(frozen=True)
class RenderOptions:
    """Renders images of a saved map along a trajectory, without the service.

    Example:
      hsslam-render runs/desk --trajectory poses.txt --video flight.mp4

    The command writes one PNG for each pose: 000000.png, 000001.png, ... Pixels without surface are black.
    It refuses a folder that already has such images.

    Exit codes: 0 if the images are written, 1 if the command is interrupted, 2 if the input is bad.

    Raises:
        UserError: an option has a value that cannot be used.
    """

    POSITIONALS: ClassVar = ("map",)
    VALUES: ClassVar = {"map": "MAP", "out": "FOLDER"}
    ALIASES: ClassVar = {"out": "-o"}

    map: str = ""
    """Run folder, or the file of a saved map."""
    trajectory: Path | None = None
    """Poses in TUM format (s, m, unit quaternion; camera to world), in the world frame of the map."""
    out: Path = Path("views")
    """Output folder of the images; created if it does not exist."""
    every: int = 1
    """Render every N-th pose."""
    downscale: float = 1.0
    """Divide the image width and height of the map's camera by X."""
    fov_deg: float | None = None
    """Horizontal field of view, degrees (none: that of the map's camera)."""
    video: Path | None = None
    """Output file of a video of the images: .mp4 or .avi (none: no video)."""
    rate_hz: float = 30.0
    """Frame rate of the video, Hz."""
    colors: Literal["keyframes", "field"] = "keyframes"
    """keyframes: colours of the keyframes near each view, and of the field where none shows the surface;
    field: of the field alone."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the map is rendered; auto: an NVIDIA GPU if one works."""

    def __post_init__(self) -> None:
        if self.every < 1:
            raise UserError(f"--every {self.every}: expected 1 or more")
        if not 1 <= self.downscale <= 16:
            raise UserError(f"--downscale {self.downscale}: expected 1 to 16")
        if self.fov_deg is not None and not 1 <= self.fov_deg <= 170:
            raise UserError(f"--fov-deg {self.fov_deg}: expected 1 to 170 degrees")
        if not 0.1 <= self.rate_hz <= 240:
            raise UserError(f"--rate-hz {self.rate_hz}: expected 0.1 to 240")
        if self.video is not None:
            expect_file("--video", self.video, tuple(_CODECS))
            if as_utf8(str(self.video.absolute())) != str(self.video.absolute()):
                raise UserError(f"--video {self.video}: OpenCV writes to paths in UTF-8 alone")

    def expect_inputs(self) -> tuple[Path, Path]:
        """The map and the trajectory; UserError if one is not given."""
        path = map_file(self.map, "render")
        if self.trajectory is None:
            raise UserError("--trajectory: missing: expected poses in TUM format")
        return path, self.trajectory


def main(args: Sequence[str] | None = None) -> None:
    """Run the command; exit code 0, 1 or 2, see `RenderOptions`."""
    given = sys.argv[1:] if args is None else args
    if code := exit_code(lambda: _render(parse_options(RenderOptions, _PROG, given))):
        sys.exit(code)


def _render(options: RenderOptions) -> None:
    map_path, trajectory = options.expect_inputs()
    poses = read_tum(trajectory).T_world_cam[:: options.every]
    if len(poses) == 0:
        raise UserError(f"--trajectory {trajectory}: no poses: expected one or more")
    if any(_IMAGE.fullmatch(path.name) for path in options.out.glob("*.png")):
        raise UserError(f"--out {options.out}: already has images: expected a new folder")
    saved = SavedMap.open(map_path, options.device)
    camera = _camera(saved.camera.undistorted(), options)
    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {options.out}: {error.strerror}: expected a folder") from None
    with _video(options, camera, len(poses)) as film, terminal_progress() as progress:
        for k in progress.track(range(len(poses)), description="images"):
            color, _ = saved.render(poses[k], camera, from_keyframes=options.colors == "keyframes")
            image = cv2.cvtColor(color, cv2.COLOR_RGB2BGR)
            path = options.out / f"{k:06d}.png"
            try:
                path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
            except OSError as error:
                path.unlink(missing_ok=True)  # half an image
                expected = "expected free space and permission"
                raise UserError(f"{path}: {error.strerror}: {expected}") from None
            film(image)
    size = f"{camera.width_px} x {camera.height_px} px"
    also = f", {options.video}" if options.video else ""
    print(f"{options.out}: {len(poses)} images, {size}{also}")


def _camera(camera: Camera, options: RenderOptions) -> Camera:
    if options.fov_deg is not None:
        focal_px = camera.width_px / 2 / np.tan(np.deg2rad(options.fov_deg) / 2)
        camera = replace(camera, fx=float(focal_px), fy=float(focal_px))
    return camera if options.downscale == 1 else camera.scaled(1 / options.downscale)


@contextmanager
def _video(
    options: RenderOptions, camera: Camera, count: int
) -> Iterator[Callable[[np.ndarray], object]]:
    """A function that takes the `count` images, BGR, of the video; writes the whole file or none.

    OpenCV does not report a failed write, so this reads the finished file.
    """
    if options.video is None:
        yield lambda image: None
        return
    codec = cv2.VideoWriter.fourcc(*_CODECS[options.video.suffix.lower()])
    size = (camera.width_px, camera.height_px)
    with out_file(options.video, "--video") as partial:
        video = cv2.VideoWriter(str(partial), codec, options.rate_hz, size)
        if not video.isOpened():
            expected = "expected .avi, and permission to write there"
            raise UserError(f"--video {options.video}: OpenCV cannot write it: {expected}")
        try:
            yield video.write
        finally:
            video.release()
        if (found := _images_in(partial)) != count:
            problem = f"has {found} of {count} images: expected free space"
            raise UserError(f"--video {options.video}: {problem}")


def _images_in(video: Path) -> int:
    reader = cv2.VideoCapture(str(video))
    found = 0
    while reader.grab():
        found += 1
    reader.release()
    return found


if __name__ == "__main__":
    main()
