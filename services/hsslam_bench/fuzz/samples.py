"""A valid message of each kind, from which malformed ones are made."""

from typing import Any

from hsslam_proto import messages as m
from hsslam_proto import request_messages as r
from hsslam_proto import run_messages
from hsslam_proto.distance.messages import SIDE, Esdf, EsdfBlocks, Grid
from hsslam_proto.mesh import messages as mesh_messages
from hsslam_proto.mesh.messages import MeshBlocks
from hsslam_proto.message import Message

_T, _Q = (0.5, -1.0, 2.0), (0.0, 0.0, 0.0, 1.0)
_WIDTH, _HEIGHT = 4, 3
_STAMP = 1_700_000_000_000_000_000

_RASTER: dict[str, Any] = {
    "index": 7,
    "stamp_ns": _STAMP,
    "source_stamp_ns": 1,
    "t": _T,
    "q": _Q,
    "resolution_m": 0.05,
    "width": _WIDTH,
    "height": _HEIGHT,
    "low_m": 0.15,
    "high_m": 1.6,
    "up_by": "floor plane",
}


def _zeros(nbytes: int) -> memoryview:
    return memoryview(bytes(nbytes))


_ALL: tuple[Message, ...] = (
    m.Frame(
        index=7,
        stamp_ns=_STAMP,
        source_stamp_ns=1,
        width_px=_WIDTH,
        height_px=_HEIGHT,
        fx=3.5,
        fy=3.5,
        cx=1.5,
        cy=1.0,
        color=_zeros(3 * _WIDTH * _HEIGHT),
        depth=_zeros(2 * _WIDTH * _HEIGHT),
        depth_units_per_m=5000.0,
        odometry=[*_T, *_Q],
        odometry_covariance=[0.0] * 21,
        odometry_series=_STAMP,
        imu=[*_Q, *_T, 0.1],
        imu_series=_STAMP,
        source_wait_ns=20_000_000,
    ),
    m.ImuSamples(stamps_ns=[_STAMP], angular_velocity=[_T], acceleration=[_T]),
    m.RobotOdometry(stamp_ns=_STAMP, t=_T, q=_Q, covariance=[0.1] * 21),
    run_messages.SourceEnd(frame_count=7, reason="end of source"),
    m.Pose(
        index=7,
        stamp_ns=_STAMP,
        source_stamp_ns=1,
        publish_ns=_STAMP,
        status="tracked",
        t=_T,
        q=_Q,
        quality=0.5,
        inlier_ratio=0.5,
        residual_mm=1.5,
        map_version=1,
        keyframe=0,
        covariance=[1e-6] * 21,
        odometry=[*_T, *_Q],
        in_keyframe=[*_T, *_Q],
        up=[0.0, 0.0, 1.0],
        stage_ms={"track": 1.5},
    ),
    m.Keyframe(id=7, frame_index=7, source_stamp_ns=1, t=_T, q=_Q),
    m.MapVersion(version=7, iterations=7, loss=0.5, keyframes=7, mapping_ms=1.5),
    m.Correction(
        pose_version=7,
        base_version=6,
        keyframes=[0, 1],
        t=[_T, _T],
        q=[_Q, _Q],
        loss_before=0.5,
        loss_after=0.25,
    ),
    mesh_messages.Mesh(
        map_version=7,
        vertex_count=3,
        face_count=1,
        vertices=_zeros(36),
        faces=memoryview(bytes([0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0])),
        colors=_zeros(9),
    ),
    MeshBlocks(
        series=7,
        revision=7,
        map_version=7,
        voxel_m=0.03,
        block_m=0.96,
        blocks=_zeros(12),
        vertex_counts=memoryview(bytes([3, 0, 0, 0])),
        face_counts=memoryview(bytes([1, 0, 0, 0])),
        vertices=_zeros(36),
        faces=memoryview(bytes([0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0])),
        colors=_zeros(9),
    ),
    m.View(
        index=7,
        stamp_ns=_STAMP,
        width_px=_WIDTH,
        height_px=_HEIGHT,
        color=_zeros(3 * _WIDTH * _HEIGHT),
    ),
    Grid(**_RASTER, cells=_zeros(_WIDTH * _HEIGHT)),
    Esdf(**_RASTER, distance_mm=_zeros(2 * _WIDTH * _HEIGHT)),
    EsdfBlocks(
        index=7,
        stamp_ns=_STAMP,
        series=7,
        revision=7,
        t=_T,
        q=_Q,
        voxel_m=0.05,
        first=(-100, -100, -3),
        voxels=(200, 200, 50),
        blocks=_zeros(12),
        distance_mm=_zeros(2 * SIDE**3),
    ),
    run_messages.Step(stage="done", index=7),
    run_messages.Health(
        process="tracker",
        pid=7,
        state="running",
        rss_bytes=7,
        counters={"tracked": 7},
        topics={"in/frame": run_messages.TopicCounts(dropped=7)},
        stage_ms={"track": 1.5},
    ),
    run_messages.Event(process="tracker", level="info", text="somewhere", stamp_ns=_STAMP),
    run_messages.Hold(paused=True),
    run_messages.Stop(reason="enough"),
    r.Ask(),
    r.SaveMap(name="room"),
    r.SetMode(mode="mapping"),
    r.QueryMap(points=_zeros(24)),
    r.Locate(x=1.5, y=-0.5, yaw_deg=90.0),
)
SAMPLES: dict[type[Message], Message] = {type(message): message for message in _ALL}
