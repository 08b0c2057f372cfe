"""The poses of a log as text."""

import csv
from collections.abc import Iterator
from pathlib import Path

from hsslam_node.geometry.trajectory import Trajectory, format_stamp, write_tum
from hsslam_node.proto import messages
from hsslam_node.services.log.log_file import Say
from hsslam_node.services.log.logged_poses import logged_poses

_COLUMNS = (
    *("index", "timestamp_s", "tx_m", "ty_m", "tz_m", "qx", "qy", "qz", "qw", "status"),
    *("quality", "inlier_ratio", "residual_mm", "latency_ms", "map_version", "keyframe"),
)


def export_trajectory(files: list[Path], folder: Path, say: Say) -> Iterator[str]:
    """trajectory_online.txt (TUM) and .csv: poses as they were published, those of lost frames in the
    CSV only; trajectory.txt (TUM): the same as refined later; keyframes.txt (TUM): keyframes where the
    last correction put them. Yields what it wrote."""
    found = logged_poses(files)
    if not found.poses:
        say("no trajectory: the log holds no poses")
        return
    yield _write(folder / "trajectory_online.txt", found.online)
    yield _write_csv(folder / "trajectory_online.csv", found.poses)
    if len(found.keyframes):
        yield _write(folder / "trajectory.txt", found.final)
        yield _write(folder / "keyframes.txt", found.keyframes)


def _write(path: Path, trajectory: Trajectory) -> str:
    write_tum(path, trajectory)
    return f"{path}: {len(trajectory)} poses"


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
