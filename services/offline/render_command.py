"""`hsslam-render`: images of a saved map along a trajectory."""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError
from hsslam_node.evaluation.map_renderer import MapRenderer
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.presets import REALTIME
from hsslam_node.services.exit_code import exit_code
from hsslam_node.services.offline.render_options import RenderOptions
from hsslam_node.services.offline.saved_map import SavedMap
from hsslam_node.services.parse_options import parse_options
from hsslam_node.services.terminal_progress import terminal_progress

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
