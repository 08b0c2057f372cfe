"""Small logs: one of everything that commands look at, and one of poses alone."""

from pathlib import Path

import msgspec
import numpy as np

from hsslam_proto import messages, run_messages, topics
from hsslam_proto.codec import encode
from hsslam_proto.foxglove.poses import DrawnPoses
from hsslam_proto.foxglove.visualisation import viz_blocks, viz_calibration, viz_messages
from hsslam_proto.mesh.codec import block_triangles
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog
from tests.services.wire_samples import blocks, frame, grid, keyframe, mesh, pose

_OF_MAP = (topics.POSE, topics.KEYFRAME)
START_NS = 1_700_000_000_000_000_000
PERIOD_NS = 100_000_000


def write_log(folder: Path, count: int = 20, color="png", second_epoch_at=None, **settings) -> Path:
    """`count` frames and poses 0.1 s apart, a keyframe every 5, a correction, two meshes, a grid, an event.

    `second_epoch_at`: from this frame on poses and keyframes are of another map."""
    log, drawn = PartedLog(folder, "r", LogSettings(color, **settings)), DrawnPoses()

    def put(topic, message, index):
        if second_epoch_at is not None and index >= second_epoch_at and topic in _OF_MAP:
            message = msgspec.structs.replace(message, map_epoch=1)
        at = START_NS + PERIOD_NS * index
        log.write(topic, encode(topic, message), at, at - 1000, index)
        is_pose = isinstance(message, messages.Pose)
        for viz in drawn.of(message) if is_pose else viz_messages(message, at):
            log.write_viz(viz, at, at)

    for index in range(count):
        image = compress_frame(textured(index), color)
        put(topics.FRAME, image, index)
        if index == 0:
            log.write_viz(viz_calibration(image), START_NS, START_NS)
        put(topics.POSE, pose(index, "lost" if index == 3 else "tracked"), index)
        if index % 5 == 0:
            put(topics.KEYFRAME, keyframe(index // 5), index)
        log._part._writer.flush()
    moved = messages.Correction(
        pose_version=1,
        base_version=0,
        keyframes=[1],
        t=[(9.0, 8.0, 7.0)],
        q=[(0.0, 0.0, 0.0, 1.0)],
        loss_before=2.0,
        loss_after=1.0,
    )
    put(topics.CORRECTION, moved, count - 1)
    put(topics.MESH_BLOCKS, blocks(1, 0, 1), 2)
    drawn = viz_blocks({(0, 0, 2): None, **block_triangles(blocks(1, 1))}, START_NS)
    log.write_viz(drawn, START_NS, START_NS)
    put(topics.MESH, mesh(final=True), count - 1)
    put(topics.GRID, grid(count - 1), count - 1)
    event = run_messages.Event(process="mapper", level="info", text="a line", stamp_ns=START_NS)
    put(topics.EVENT, event, 0)
    log.close()
    return folder / "run.mcap"


def textured(index: int) -> messages.Frame:
    """A frame whose pixels tell its index."""
    noise = np.random.default_rng(index)
    message = frame(index)
    color = noise.integers(0, 256, (message.height_px, message.width_px, 3), np.uint8)
    depth = noise.integers(0, 60_000, (message.height_px, message.width_px)).astype("<u2")
    fields = {name: getattr(message, name) for name in message.__struct_fields__}
    fields |= {"color": color.data.cast("B"), "depth": depth.data.cast("B"), "fx": 51.234567890123}
    return messages.Frame(**fields)


def write_poses(folder: Path, count: int) -> Path:
    """A finished log of `count` poses, a chunk each."""
    log = PartedLog(folder, "r", LogSettings(metadata={"a": "b"}))
    for index in range(count):
        log.write(topics.POSE, encode(topics.POSE, pose(index)), 1000 + index, 1000 + index, index)
        log._part._writer.flush()
    log.close()
    return log.path
