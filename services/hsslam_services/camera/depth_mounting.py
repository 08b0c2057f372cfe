"""Decides whether depth of ROS is registered to colour here, and by which mounting of its camera."""

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.depth_registration import DepthMounting
from hsslam_node.sources.reports import Report, Reports
from hsslam_services.camera.ros_frames import intrinsics_text

_REGISTERED = re.compile("(?<!un)(aligned|registered)")
_UNREGISTERED = re.compile("un(aligned|registered)")
_SAME_K_PX = 1.0
_SAME_WAY = 0.7  # cosine between the axes of both cameras


@dataclass(frozen=True)
class ShownImages:
    """The images of a topic, as the first of them shows them."""

    topic: str
    camera: Camera  # by K of `camera_info`, rectified or not
    frame_id: str  # ROS name of the camera's optical frame


def is_named_registered(topic: str) -> bool:
    """Whether the name of a depth topic says that depth is registered to colour."""
    return _REGISTERED.search(topic) is not None


def is_named_unregistered(topic: str) -> bool:
    """Whether the name of a depth topic says that depth is not registered to colour."""
    return _UNREGISTERED.search(topic) is not None


def depth_mounting(
    source: str,
    color: ShownImages,
    depth: ShownImages,
    depth_camera: Camera,
    T_color_depth: np.ndarray | None,
    reports: Reports,
) -> DepthMounting | None:
    """How the depth camera is mounted; None if depth is registered to colour. Reports what it finds.

    Depth is registered if it has the intrinsics of colour.

    Args:
        source: its name in errors.
        depth_camera: by P of `camera_info` if the images are rectified, else by K.
        T_color_depth: [4, 4], metres; None: not known.

    Raises:
        UserError: depth has other intrinsics than colour, and is named registered or has no known mounting.
    """
    if not differ(color.camera, depth.camera):
        report_other_frame(depth.topic, color.frame_id, depth.frame_id, reports)
        return None
    if T_color_depth is None or is_named_registered(depth.topic):
        raise _not_registered(source, color, depth)
    if T_color_depth[2, 2] < _SAME_WAY:
        raise UserError(
            f"source {source}: {depth.topic}: frame_id {depth.frame_id} looks another way than that of "
            f"{color.topic}, {color.frame_id}, by /tf_static: expected the optical frames of both cameras"
        )
    distance_mm = 1e3 * float(np.linalg.norm(T_color_depth[:3, 3]))
    text = (
        f"{depth.topic}: its camera is {distance_mm:.1f} mm from that of {color.topic}: each image is moved "
        "into the colour image"
    )
    reports.add(Report("depth is registered here", text))
    return DepthMounting(depth_camera, T_color_depth)


def both_cameras(camera_of: Callable[[str], Camera], topic: str) -> tuple[Camera, Camera]:
    """The camera of a `camera_info` as the name of the topic asks, and by K; twice the same if P or K is not
    usable. `camera_of("")`: by K.

    Raises:
        UserError: neither is usable.
    """
    try:
        camera = camera_of(topic)
    except UserError:
        camera = camera_of("")
    try:
        return camera, camera_of("")
    except UserError:
        return camera, camera


def differ(one: Camera, other: Camera) -> bool:
    """Whether two cameras have other sizes or other camera matrices."""
    sizes = [(camera.width_px, camera.height_px) for camera in (one, other)]
    return sizes[0] != sizes[1] or bool(np.abs(one.K - other.K).max() > _SAME_K_PX)


def names_other_frame(color_frame: str, depth_frame: str) -> bool:
    """Whether two `frame_id` say that depth is of another camera than colour."""
    return bool(color_frame and depth_frame) and color_frame != depth_frame


def report_other_frame(
    depth_topic: str, color_frame: str, depth_frame: str, reports: Reports
) -> None:
    """Report if depth that counts as registered names another frame than colour."""
    if names_other_frame(color_frame, depth_frame):
        text = (
            f"{depth_topic}: frame_id {depth_frame}: expected {color_frame} as colour, if depth is "
            "registered to it (realsense: align_depth.enable:=true)"
        )
        reports.add(Report("frame_id of depth", text))


def _not_registered(source: str, color: ShownImages, depth: ShownImages) -> UserError:
    if is_named_registered(depth.topic):
        where = "as its name says"
    else:
        frames = f"from {depth.frame_id or 'depth'} to {color.frame_id or 'colour'}"
        where = f"(realsense: align_depth.enable:=true), or a transform {frames} on /tf_static"
    return UserError(
        f"source {source}: {depth.topic} has {_text(depth.camera)}, {color.topic} has "
        f"{_text(color.camera)}: expected depth that is registered to colour {where}"
    )


def _text(camera: Camera) -> str:
    return f"{camera.width_px}x{camera.height_px} pixels and fx, fy, cx, cy = {intrinsics_text(camera)}"
