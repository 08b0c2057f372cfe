"""Converts our messages to Foxglove protobuf messages, which viewers open without an extension.

Frames: `world` and `camera`, OpenCV axes (x right, y down, z forward), m. `poses.py` converts poses.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from hsslam_proto import messages, run_messages
from hsslam_proto.block_revisions import Block
from hsslam_proto.distance.messages import Grid
from hsslam_proto.foxglove.grid import drawn_grid
from hsslam_proto.foxglove.mesh import blocks_update, scene_update
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.codec import Triangles
from hsslam_proto.message import Message

WORLD, CAMERA = "world", "camera"
_LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}


@dataclass(frozen=True)
class VizMessage:
    """One message of the /viz layer: its topic, protobuf schema and payload."""

    topic: str
    schema: type[Any]
    payload: bytes


def viz_messages(message: Message, stamp_ns: int) -> list[VizMessage]:
    """The /viz messages of any message but a pose; only frames with JPEG colour are drawn."""
    match message:
        case messages.Frame(color_encoding="jpeg"):
            return [viz("/viz/camera/image", _image(message))]
        case mesh_messages.Mesh():
            return [VizMessage("/viz/mesh", SceneUpdate, scene_update(message, WORLD, stamp_ns))]
        case Grid():
            return [viz("/viz/grid", drawn_grid(message, WORLD))]
        case run_messages.Event():
            return [viz("/viz/log", _log(message))]
        case _:
            return []


def viz_calibration(frame: messages.Frame) -> VizMessage:
    """The /viz message of the camera of a frame; viewers use the newest for all images."""
    return viz("/viz/camera/calibration", _calibration(frame))


def viz_blocks(blocks: Mapping[Block, Triangles | None], stamp_ns: int) -> VizMessage:
    """The /viz message of blocks of the live mesh; None: the block has no surface any more."""
    return VizMessage("/viz/mesh", SceneUpdate, blocks_update(blocks, WORLD, stamp_ns))


def cleared_scene(stamp_ns: int) -> VizMessage:
    """Removes all meshes drawn before, after a reset of the map."""
    deletion = SceneEntityDeletion(type=SceneEntityDeletion.ALL)
    deletion.timestamp.FromNanoseconds(stamp_ns)
    return viz("/viz/mesh", SceneUpdate(deletions=[deletion]))


def viz(topic: str, message: Any) -> VizMessage:
    """A message of the layer, of a protobuf message."""
    return VizMessage(topic, type(message), message.SerializeToString())


def _image(frame: messages.Frame) -> CompressedImage:
    image = CompressedImage(frame_id=CAMERA, data=bytes(frame.color), format="jpeg")
    image.timestamp.FromNanoseconds(frame.stamp_ns)
    return image


def _calibration(frame: messages.Frame) -> CameraCalibration:
    fx, fy, cx, cy = frame.fx, frame.fy, frame.cx, frame.cy
    calibration = CameraCalibration(
        frame_id=CAMERA,
        width=frame.width_px,
        height=frame.height_px,
        distortion_model="plumb_bob",
        D=[0.0] * 5,
        K=[fx, 0, cx, 0, fy, cy, 0, 0, 1],
        R=[1, 0, 0, 0, 1, 0, 0, 0, 1],
        P=[fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0],
    )
    calibration.timestamp.FromNanoseconds(frame.stamp_ns)
    return calibration


def _log(event: run_messages.Event) -> Log:
    log = Log(level=_LEVELS[event.level], message=event.text, name=event.process)
    log.timestamp.FromNanoseconds(event.stamp_ns)
    return log
