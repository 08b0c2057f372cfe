"""Trajectories as the text of several formats."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np

from hsslam_node.geometry.se3_batch import quaternions_from_rotations
from hsslam_node.geometry.trajectory import Trajectory, format_stamp, tum_text

TrajectoryFormat = Literal["tum", "kitti", "euroc", "csv"]

KITTI_TIMES = ".kitti.times.txt"
"""Suffix of the file with `stamps_text`, beside the one in the format kitti."""

_EUROC_HEAD = "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
_CSV_HEAD = "timestamp_s,tx_m,ty_m,tz_m,qx,qy,qz,qw"


def kitti_text(trajectory: Trajectory) -> str:
    """A line of 12 numbers a pose: the upper three rows of T_world_cam, m. `stamps_text` has the stamps.

    Source: readme of the odometry benchmark, https://www.cvlibs.net/datasets/kitti/eval_odometry.php
    """
    rows = trajectory.T_world_cam[:, :3].reshape(-1, 12).tolist()
    return "".join(" ".join(f"{number:.9f}" for number in row) + "\n" for row in rows)


def stamps_text(trajectory: Trajectory) -> str:
    """A line a pose: its stamp, s; as KITTI's times.txt, which begins at 0."""
    return "".join(f"{format_stamp(stamp_ns)}\n" for stamp_ns in trajectory.stamps_ns.tolist())


def euroc_text(trajectory: Trajectory) -> str:
    """Lines `stamp,x,y,z,qw,qx,qy,qz` (ns, m, unit quaternion), camera to world.

    Source: the ground truth of the EuRoC MAV dataset, state_groundtruth_estimate0/data.csv
    """
    x, y, z, w = _quaternions(trajectory).T
    numbers = np.column_stack([trajectory.positions, w, x, y, z])
    stamps = map(str, trajectory.stamps_ns.tolist())
    return _comma_lines(_EUROC_HEAD, stamps, numbers)


def csv_text(trajectory: Trajectory) -> str:
    """A line of column names, then `stamp,x,y,z,qx,qy,qz,qw` (s, m, unit quaternion), camera to world."""
    numbers = np.column_stack([trajectory.positions, _quaternions(trajectory)])
    stamps = map(format_stamp, trajectory.stamps_ns.tolist())
    return _comma_lines(_CSV_HEAD, stamps, numbers)


TRAJECTORY_FORMATS: Mapping[TrajectoryFormat, tuple[str, Callable[[Trajectory], str]]] = (
    MappingProxyType(
        {
            "tum": (".txt", tum_text),
            "kitti": (".kitti.txt", kitti_text),
            "euroc": (".euroc.csv", euroc_text),
            "csv": (".csv", csv_text),
        }
    )
)
"""By format: suffix of the file, and the function that makes its text."""


def _quaternions(trajectory: Trajectory) -> np.ndarray:
    """[N, 4] xyzw."""
    return quaternions_from_rotations(trajectory.T_world_cam[:, :3, :3])


def _comma_lines(head: str, stamps: map, numbers: np.ndarray) -> str:
    """The head, then a stamp and a row of numbers [N, m] a line."""
    lines = (
        ",".join([stamp, *(f"{number:.9f}" for number in row)])
        for stamp, row in zip(stamps, numbers.tolist(), strict=True)
    )
    return "\n".join([head, *lines]) + "\n"
