"""Finds where the depth camera of a bag sits, if depth is not registered to colour."""

import re
from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.depth_registration import DepthMounting
from hsslam_node.sources.files.image_files import BadImageError
from hsslam_node.sources.reports import Report, Reports
from hsslam_services.camera.bags import realsense_recording
from hsslam_services.camera.bags.bag_file import BagFile
from hsslam_services.camera.ros_frames import intrinsics_text

REGISTERED = re.compile("aligned|registered")  # in the name of a topic
_SAME_K_PX = 1.0
_SAME_PLACE = 1e-4  # metres, and sine of the angle


@dataclass(frozen=True)
class BagImages:
    """The images of a topic, as the first of them shows them."""

    topic: str
    camera: Camera
    frame_id: str  # ROS name of the camera's optical frame


def depth_mounting(
    bag: BagFile, color: BagImages, depth: BagImages, reports: Reports
) -> DepthMounting | None:
    """How the depth camera is mounted; None if depth is registered to colour. Reports what it finds.

    Depth is registered if the name of its topic says so, or if the bag has no other mounting of its camera.
    The mounting comes from the recording of a RealSense camera, or from `/tf_static`.

    Raises:
        UserError: depth has other intrinsics than colour, and is not registered or its mounting is not known.
    """
    T_color_depth = None
    if not REGISTERED.search(depth.topic):
        T_color_depth = _T_color_depth(bag, color, depth, reports)
    differ = _differ(color.camera, depth.camera)
    if T_color_depth is None and differ:
        raise _not_registered(bag, color, depth)
    if T_color_depth is None or not (differ or _is_apart(T_color_depth)):
        return None
    distance_mm = 1e3 * float(np.linalg.norm(T_color_depth[:3, 3]))
    reports.add(
        Report(
            "depth is registered here",
            f"{depth.topic}: its camera is {distance_mm:.1f} mm from that of {color.topic}: each image is "
            "moved into the colour image",
        )
    )
    return DepthMounting(depth.camera, T_color_depth)


def _T_color_depth(
    bag: BagFile, color: BagImages, depth: BagImages, reports: Reports
) -> np.ndarray | None:
    """The pose of the depth camera in the colour camera, [4, 4]; None if the bag has none."""
    try:
        found = realsense_recording.mounted_at(bag, color.topic, depth.topic)
    except (BadImageError, UserError) as error:
        raise UserError(
            f"source {bag.name}: {depth.topic}: mounting of the camera: {error}"
        ) from None
    if found is None and depth.frame_id and color.frame_id and depth.frame_id != color.frame_id:
        found = bag.static_transforms(reports).between(color.frame_id, depth.frame_id)
    return found


def _differ(color: Camera, depth: Camera) -> bool:
    """Whether two cameras have other sizes or other camera matrices."""
    sizes = [(camera.width_px, camera.height_px) for camera in (color, depth)]
    return sizes[0] != sizes[1] or bool(np.abs(color.K - depth.K).max() > _SAME_K_PX)


def _is_apart(T_color_depth: np.ndarray) -> bool:
    return bool(np.abs(T_color_depth - np.eye(4)).max() > _SAME_PLACE)


def _not_registered(bag: BagFile, color: BagImages, depth: BagImages) -> UserError:
    if REGISTERED.search(depth.topic):
        where = "as its name says"
    else:
        frames = f"from {depth.frame_id or 'depth'} to {color.frame_id or 'colour'}"
        where = f"(realsense: align_depth.enable:=true), or a transform {frames} on /tf_static"
    return UserError(
        f"source {bag.name}: {depth.topic} has {_text(depth.camera)}, {color.topic} has "
        f"{_text(color.camera)}: expected depth that is registered to colour {where}"
    )


def _text(camera: Camera) -> str:
    return f"{camera.width_px}x{camera.height_px} pixels and fx, fy, cx, cy = {intrinsics_text(camera)}"
