"""The poses of a log as text."""

import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from hsslam_node.geometry.se3 import transform
from hsslam_node.geometry.trajectory import Trajectory, format_stamp, write_tum
from hsslam_node.proto import messages
from hsslam_node.proto.messages import Quaternion, Vector
from hsslam_node.proto.topics import CORRECTION, KEYFRAME, POSE
from hsslam_node.services.log.log_file import Say, bus_messages

_COLUMNS = (
    *("index", "timestamp_s", "tx_m", "ty_m", "tz_m", "qx", "qy", "qz", "qw", "status"),
    *("quality", "inlier_ratio", "residual_mm", "latency_ms", "map_version", "keyframe"),
)


def export_trajectory(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """trajectory_online.txt (TUM) and .csv: poses as they were published, those of lost frames in the
    CSV only; keyframes.txt (TUM): keyframes where the last correction put them. Yields what it wrote."""
    poses: list[messages.Pose] = []
    keyframes: dict[int, tuple[int, Vector, Quaternion]] = {}
    for logged in bus_messages(files, {POSE.name, KEYFRAME.name, CORRECTION.name}):
        match logged.message():
            case messages.Pose() as pose:
                poses.append(pose)
            case messages.Keyframe() as keyframe:
                keyframes[keyframe.id] = (keyframe.source_stamp_ns, keyframe.t, keyframe.q)
            case messages.Correction() as moved:
                for k, t, q in zip(moved.keyframes, moved.t, moved.q, strict=True):
                    if k in keyframes:
                        keyframes[k] = (keyframes[k][0], t, q)
    if not poses:
        say("no trajectory: the log holds no poses")
        return
    known = [(p.source_stamp_ns, p.t, p.q) for p in poses if p.status != "lost"]
    yield _write(folder / "trajectory_online.txt", known)
    yield _write_csv(folder / "trajectory_online.csv", poses)
    if keyframes:
        yield _write(folder / "keyframes.txt", [keyframes[k] for k in sorted(keyframes)])


def _write(path: Path, rows: list[tuple[int, Vector, Quaternion]]) -> str:
    stamps = np.array([stamp for stamp, _, _ in rows], np.int64)
    poses = np.array([transform(np.array(t), np.array(q)) for _, t, q in rows])
    write_tum(path, Trajectory(stamps, poses.reshape(-1, 4, 4)))
    return f"{path}: {len(rows)} poses"


def _write_csv(path: Path, poses: list[messages.Pose]) -> str:
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(_COLUMNS)
        for p in poses:
            latency_ms = f"{(p.publish_ns - p.stamp_ns) / 1e6:.3f}"
            quality = (p.quality, p.inlier_ratio, p.residual_mm, latency_ms)
            stamp = format_stamp(p.source_stamp_ns)
            row = (p.index, stamp, *p.t, *p.q, p.status, *quality, p.map_version, p.keyframe)
            writer.writerow(row)
    return f"{path}: {len(poses)} poses"
