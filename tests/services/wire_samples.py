"""Messages for the tests of bus, log and viewer."""

import time

import numpy as np

from hsslam_proto import messages
from hsslam_proto.distance.messages import Grid
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.codec import BlockLattice, Triangles, blocks_message, mesh_message
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_services.log.frame_compression import compress_frame


def frame(index: int, compressed: bool = False, width_px: int = 64, height_px: int = 48):
    """A gradient with a plane 2 m away."""
    color = np.zeros((height_px, width_px, 3), np.uint8)
    color[..., 0] = np.linspace(0, 255, width_px)
    color[..., 1] = index * 5 % 256
    message = messages.Frame(
        index=index,
        stamp_ns=time.time_ns(),
        source_stamp_ns=index * 33_333_333,
        width_px=width_px,
        height_px=height_px,
        fx=width_px * 0.8,
        fy=width_px * 0.8,
        cx=width_px / 2 - 0.5,
        cy=height_px / 2 - 0.5,
        color=color.data.cast("B"),
        depth=np.full((height_px, width_px), 10_000, "<u2").data.cast("B"),
        depth_units_per_m=5000.0,
    )
    return compress_frame(message) if compressed else message


def pose(index: int, status="tracked") -> messages.Pose:
    """A camera that moves along x."""
    now = time.time_ns()
    return messages.Pose(
        index=index,
        stamp_ns=now - 20_000_000,
        source_stamp_ns=index * 33_333_333,
        publish_ns=now,
        status=status,
        t=(float(index), 0.0, 0.0),
        q=(0.0, 0.0, 0.0, 1.0),
        quality=0.9,
        inlier_ratio=0.8,
        residual_mm=2.0,
        map_version=1,
        keyframe=0,
        stage_ms={"align": 5.0},
    )


def keyframe(index: int) -> messages.Keyframe:
    """A keyframe at x = index."""
    return messages.Keyframe(
        id=index,
        frame_index=index,
        source_stamp_ns=index,
        t=(float(index), 0.0, 0.0),
        q=(0.0, 0.0, 0.0, 1.0),
    )


def grid(index: int) -> Grid:
    """A post on a floor of 1 x 1.5 m, 1 m below the first camera, with an unknown corner."""
    cells = np.zeros((15, 10), np.int8)
    cells[7, 5], cells[12:, 8:] = 100, -1
    return Grid(
        index=index,
        stamp_ns=time.time_ns(),
        source_stamp_ns=index,
        t=(0.5, 1.0, 0.0),
        q=(-0.5, 0.5, -0.5, -0.5),
        resolution_m=0.1,
        width=10,
        height=15,
        low_m=0.15,
        high_m=1.6,
        up_by="floor plane",
        cells=cells.reshape(-1).view(np.uint8).data,
    )


def blocks(revision: int, *chosen: int) -> MeshBlocks:
    """A triangle in each block (i, 0, 2) of 1 m."""
    faces = np.array([[0, 1, 2]], np.uint32)
    changed = [
        (
            (i, 0, 2),
            Triangles(
                np.array([[i, 0, 2], [i + 1, 0, 2], [i + 1, 1, 2]], np.float32),
                faces,
                np.full((3, 3), 200, np.uint8),
            ),
        )
        for i in chosen
    ]
    lattice = BlockLattice(0.5, 1.0)
    return blocks_message(changed, lattice, series=1, revision=revision, map_version=1)


def mesh(final: bool = False) -> mesh_messages.Mesh:
    """Two triangles 2 m in front of the first camera."""
    vertices = np.array([[0, 0, 2], [1, 0, 2], [1, 1, 2], [0, 1, 2]], "<f4")
    faces = np.array([[0, 1, 2], [0, 2, 3]], "<u4")
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]], np.uint8)
    return mesh_message(vertices, faces, colors, map_version=1, final=final)
