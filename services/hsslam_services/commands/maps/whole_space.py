"""Floor, free and occupied space of a saved map; `hsslam-map grid` and `esdf` share it."""

import math
import sys
from pathlib import Path

import numpy as np

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.distance.floor_plane import FloorPlane, find_floor, floor_by
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.voxel_grid import GridSizeError
from hsslam_node.distance.whole_map import NoDepthError, whole_map
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.robot_frames import RobotFrames, level_frame
from hsslam_node.presets import REALTIME

MAP_NAME = "map.safetensors"
# of a voxel at --far-m; in the built-in room 98 % of the surface is found with 1.2, 70 % or less with 0.8
_SMALLEST_SIDE_PX = 1.2


def map_file(text: str, command: str) -> Path:
    """The file of a saved map; `text` is the file or its run folder.

    Raises:
        UserError: `text` is empty.
    """
    if not text:
        raise UserError(f"{command}: no map: expected a run folder or {MAP_NAME}")
    path = Path(text)
    return path / MAP_NAME if path.is_dir() else path


def expect_space(
    from_height_m: float,
    to_height_m: float,
    up: tuple[float, ...],
    base_T_camera: tuple[float, ...],
    voxel_m: float,
) -> None:
    """Raise UserError unless heights rise, at most one option gives up as a direction, and voxels fit."""
    if not from_height_m < to_height_m:
        given = f"--from-height-m {from_height_m:g} --to-height-m {to_height_m:g}"
        raise UserError(f"{given}: expected from < to")
    length = math.hypot(*up)
    if up and not (len(up) == 3 and math.isfinite(length) and length > 0):
        given = " ".join(f"{number:g}" for number in up)
        raise UserError(f"--up {given}: expected a direction X Y Z in the world frame of the map")
    RobotFrames.mounted(base_T_camera)
    if up and base_T_camera:
        raise UserError("--up, --base-T-camera: both define up: expected one of them")
    if not (math.isfinite(voxel_m) and 0.01 <= voxel_m <= 0.5):
        raise UserError(f"--voxel {voxel_m}: expected 0.01 to 0.5 m")


def expect_far(far_m: float) -> None:
    """Raise UserError unless `--far-m` is a depth that mapping may use."""
    if not 0 < far_m <= REALTIME.mapper.max_depth_m:
        raise UserError(
            f"--far-m {far_m}: expected metres above 0, {REALTIME.mapper.max_depth_m:g} at most"
        )


def floor_and_space(
    saved: SavedMap,
    up: tuple[float, ...],
    base_T_camera: tuple[float, ...],
    voxel_m: float,
    far_m: float,
) -> tuple[FloorPlane, Occupancy]:
    """The floor, and free and occupied voxels in a frame with z up and the floor at z = 0.

    Up is `up` if it is set. Otherwise the frame is that of a running service: `map` of the robot, except for
    the height, if `base_T_camera` is set or the map has it; else up is against gravity if the map has it,
    else the normal of the floor.

    Raises:
        UserError: no keyframe has depth, the map is too large for such voxels, or its camera too coarse.
    """
    views, camera, known = saved.keyframes.views, saved.keyframes.camera, saved.checkpoint
    _expect_pixels(camera, voxel_m, min(far_m, saved.max_depth_m))
    if up:
        direction = np.array(up) / math.hypot(*up)
        floor = find_floor(views, camera, direction, max_depth_m=saved.max_depth_m)
    else:
        given = level_frame(base_T_camera, in_ros=False)
        level = known.T_level_world if given is None else given
        floor = floor_by(known.gravity, views, camera, level, saved.max_depth_m)
        if level is not None:
            seen = floor_by(known.gravity, views, camera, max_depth_m=saved.max_depth_m)
            if tilt := floor.tilt_against(seen):
                print(f"warning: {tilt}, or --up here", file=sys.stderr)
    try:
        return floor, whole_map(views, camera, floor, voxel_m, far_m, saved.max_depth_m)
    except GridSizeError as error:
        raise UserError(f"--voxel {voxel_m:g}: {error}") from None
    except NoDepthError as error:
        raise UserError(f"--far-m {far_m:g}: {error}") from None


def _expect_pixels(camera: Camera, voxel_m: float, far_m: float) -> None:
    """Raise UserError if a voxel at `far_m` has too few pixels: such surfaces would be left out."""
    focal_px = min(camera.fx, camera.fy)
    least_m, most_m = _SMALLEST_SIDE_PX * far_m / focal_px, focal_px * voxel_m / _SMALLEST_SIDE_PX
    if voxel_m < least_m:
        raise UserError(
            f"--voxel {voxel_m:g} --far-m {far_m:g}: expected --voxel of at least {_up(least_m):g}, or "
            f"--far-m of at most {-_up(-most_m):g}: in images of focal length {focal_px:.0f} px, smaller "
            "voxels that far away have too few pixels to be found occupied"
        )


def _up(metres: float) -> float:
    """Rounded up to mm."""
    return math.ceil(1000 * metres) / 1000
