"""Drive from Nav2: one line for each of its commands, with the robot's pose and the room along the plan.

    python examples/drive_from_nav2.py [tcp/127.0.0.1:7447 [/hsslam [COMMANDS]]]

It listens to a run with `--grid --ros2-out /hsslam`, and to Nav2's topics /plan and /cmd_vel, in the domain
of the environment variable ROS_DOMAIN_ID (none: 0). They may come from a bag that is played. It needs no ROS:
zenoh receives what nodes with rmw_zenoh send, and rosbags decodes it (pip install 'hsslam-node[ros2]'). It
ends after COMMANDS commands, or if nothing comes for 10 s.
"""

import contextlib
import json
import os
import queue
import sys
import time
from itertools import pairwise
from typing import Any

import numpy as np
import zenoh
import zenoh.ext
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from scipy.ndimage import distance_transform_edt

from hsslam_node.geometry.se3 import inverse, transform

DOMAIN, SILENCE_S = os.environ.get("ROS_DOMAIN_ID", "") or "0", 10.0
OLD_S = 1.0  # age of a pose or a map from which on it says nothing about the robot
OCCUPIED, UNKNOWN = 100, -1
STORE = get_typestore(Stores.ROS2_JAZZY)


def main(
    endpoint: str = "tcp/127.0.0.1:7447", namespace: str = "/hsslam", commands: str = ""
) -> None:
    """Print a line for each command."""
    if commands and not commands.isdecimal():
        sys.exit(f"{commands}: expected a number of commands")
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    namespace = "/" + namespace.strip("/")
    try:
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        session = zenoh.open(config)
    except zenoh.ZError:
        sys.exit(f"{endpoint}: no router: expected hsslam-serve --grid --ros2-out {namespace}")
    heard: queue.Queue[zenoh.Sample] = queue.Queue()
    keep = zenoh.handlers.Callback(heard.put, indirect=False)  # in the order of all topics
    drive, printed = Drive(), 0
    with session:
        _kept = [  # the newest map comes at once
            zenoh.ext.declare_advanced_subscriber(
                session,
                f"{DOMAIN}{namespace}/map/*/*",
                keep,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            ),
            *(
                session.declare_subscriber(f"{DOMAIN}{topic}/*/*", keep)
                for topic in (f"{namespace}/pose", "/plan", "/cmd_vel")
            ),
        ]
        while not commands or printed < int(commands):
            try:
                sample = heard.get(timeout=SILENCE_S)
            except queue.Empty:
                sys.exit(
                    f"nothing came in ROS domain {DOMAIN} for {SILENCE_S:g} s: the run has ended, or "
                    "publishes nothing"
                )
            kind = str(sample.key_expr).split("/")[-2]  # as nav_msgs::msg::dds_::Path_
            kind = kind.replace("dds_::", "").removesuffix("_").replace("::", "/")
            try:
                message = STORE.deserialize_cdr(sample.payload.to_bytes(), kind)
            except (SerdeError, KeyError):
                print(f"{sample.key_expr}: cannot be read", file=sys.stderr)
                continue
            if (line := drive.hear(kind.rpartition("/")[2], message)) is not None:
                printed += 1
                print(line, flush=True)


class Drive:
    """The newest grid, pose and plan."""

    def __init__(self) -> None:
        self.grid: Any = None
        self.to_blocked_m = np.zeros((0, 0))  # of each cell, to the nearest that is not free
        self.pose: Any = None
        self.plan: Any = None
        self.heard_s = {"map": 0.0, "pose": 0.0}  # when the newest came

    def hear(self, kind: str, message: Any) -> str | None:
        """Take a message; the line to print, if it is a command."""
        match kind:
            case "OccupancyGrid":
                self.grid = message
                cells = message.data.reshape(message.info.height, message.info.width)
                to_blocked = np.asarray(distance_transform_edt(np.pad(cells == 0, 1)))[1:-1, 1:-1]
                self.to_blocked_m = message.info.resolution * np.maximum(to_blocked - 0.5, 0)
                self.heard_s["map"] = time.monotonic()
            case "PoseWithCovarianceStamped":
                self.pose = message
                self.heard_s["pose"] = time.monotonic()
            case "Path":
                self.plan = message
            case "Twist":
                return self.line(message)
            case "TwistStamped":
                return self.line(message.twist)
        return None

    def line(self, command: Any) -> str:
        """What is known at a command."""
        told = f"command {command.linear.x:.2f} m/s {command.angular.z:.2f} rad/s"
        if self.grid is None:
            return f"no map yet; {told}"
        frame = self.grid.header.frame_id
        if self.pose is None or self.pose.header.frame_id != frame:
            return f"no pose in {frame} yet; {told}"
        for name, heard_s in self.heard_s.items():
            if (age_s := time.monotonic() - heard_s) > OLD_S:
                return f"{name} is {age_s:.0f} s old; {told}"
        T_map_base = matrix(self.pose.pose.pose.position, self.pose.pose.pose.orientation)
        (x, y), ahead = T_map_base[:2, 3], T_map_base[:2, 0]
        yaw_deg = np.rad2deg(np.arctan2(ahead[1], ahead[0]))
        return f"at {x:.2f} {y:.2f} m, {yaw_deg:.0f} deg; {self.room(T_map_base[:2, 3])}; {told}"

    def room(self, at: np.ndarray) -> str:
        """Clearance along the rest of the plan, from the robot's place `at` [2] m on, and what it crosses.

        The clearance is the distance to the nearest cell that is occupied or unknown. Outside the grid all is
        unknown.
        """
        if self.plan is None or not len(self.plan.poses):
            return "no plan"
        frame, grid = self.grid.header.frame_id, self.grid
        if self.plan.header.frame_id != frame:
            return f"plan in {self.plan.header.frame_id}: expected {frame}"
        points = np.array([(p.pose.position.x, p.pose.position.y) for p in self.plan.poses])
        points = points[np.argmin(np.linalg.norm(points - at, axis=1)) :]
        way = along(points, grid.info.resolution / 2)
        T_grid_map = inverse(matrix(grid.info.origin.position, grid.info.origin.orientation))
        on_grid = way @ T_grid_map[:2, :2].T + T_grid_map[:2, 3]
        columns, rows = np.unique(np.floor(on_grid / grid.info.resolution).astype(int), axis=0).T
        height, width = grid.info.height, grid.info.width
        inside = (columns >= 0) & (rows >= 0) & (columns < width) & (rows < height)
        cells = np.full(len(rows), UNKNOWN)
        cells[inside] = grid.data.reshape(height, width)[rows[inside], columns[inside]]
        room_m = self.to_blocked_m[rows[inside], columns[inside]].min() if inside.all() else 0.0
        crossed = [
            f"{count} {name}"
            for name, count in (
                ("occupied", np.count_nonzero(cells == OCCUPIED)),
                ("unknown", np.count_nonzero(cells == UNKNOWN)),
            )
            if count
        ]
        what = f"crosses {', '.join(crossed)} cells" if crossed else "is free"
        return f"plan {what}, clearance {room_m:.2f} m"


def along(points: np.ndarray, step_m: float) -> np.ndarray:
    """Points [M, 2] at most a step apart on the line through points [N, 2] m."""
    parts = [points[:1]]
    for begin, end in pairwise(points):
        count = max(1, int(np.ceil(np.linalg.norm(end - begin) / step_m)))
        parts.append(begin + (end - begin) * np.arange(1, count + 1)[:, None] / count)
    return np.concatenate(parts)


def matrix(t: Any, q: Any) -> np.ndarray:
    """A pose or transform of ROS as [4, 4]."""
    return transform(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))


if __name__ == "__main__":
    if len(sys.argv) > 4 or sys.argv[1:] == ["--help"]:
        sys.exit(__doc__)
    with contextlib.suppress(KeyboardInterrupt):
        main(*sys.argv[1:])
