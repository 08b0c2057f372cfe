"""A robot beside a run: a planner takes grid and distances, ROS nodes take their topics, a viewer is open."""

import contextlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import zenoh

from hsslam_bench.runs.viewers import AttachedViewer
from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_services.bus.bus import open_router
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.run.run_info import RUN_FILE, RunInfo

NAMESPACE = "/hsslam"
_PLANNER = (topics.GRID, topics.ESDF, topics.ESDF_BLOCKS)
_ROS = {
    **{name: f"0{NAMESPACE}/{name}/*/*" for name in ("odom", "pose", "path", "points", "map")},
    "static_map_slice": f"0{NAMESPACE}/static_map_slice/*/*",
    "tf": "0/tf/*/*",
}


class AttachedRobot(AttachedViewer):
    """Subscribes to all that a robot takes, and notes when each message arrives.

    `ros_router`: endpoint at which it opens the router of ROS nodes, as rmw_zenohd does.
    """

    def __init__(self, run_folder: Path, ros_router: str) -> None:
        super().__init__(run_folder)
        names = [*(f"ros:{name}" for name in _ROS), *(topic.name for topic in _PLANNER)]
        self._arrivals_ns: dict[str, list[int]] = {name: [] for name in names}  # wall clock
        self._ros = open_router(ros_router)
        self._subscribers = [
            self._ros.declare_subscriber(key, self._noted(f"ros:{name}"))
            for name, key in _ROS.items()
        ]
        self._planner: zenoh.Session | None = None

    def poll(self) -> None:
        """Attach the viewer; connect the planner once there is a run."""
        super().poll()
        if self._planner is None and self._has_run():
            with contextlib.suppress(UserError):  # its router does not listen yet
                run = RunInfo.read(self._run_folder)
                self._planner = open_client(run.endpoint, timeout_s=0.1)
                self._subscribers += [
                    self._planner.declare_subscriber(topic.key(run.robot), self._noted(topic.name))
                    for topic in _PLANNER
                ]

    def found(self) -> dict[str, Any]:
        """The figures of the viewer, and the times of arrival, ns of the wall clock, by topic."""
        return {**super().found(), "arrivals_ns": self._arrivals_ns}

    def close(self) -> None:
        """Disconnect, and end the viewer."""
        super().close()
        for session in (self._planner, self._ros):
            if session is not None:
                session.close()

    def _has_run(self) -> bool:
        """Whether the run folder is of this run, not of an earlier one."""
        with contextlib.suppress(OSError):
            return (self._run_folder / RUN_FILE).stat().st_mtime >= self._since_s
        return False

    def _noted(self, name: str) -> Callable[[zenoh.Sample], None]:
        arrivals_ns = self._arrivals_ns[name]

        def note(sample: zenoh.Sample) -> None:
            sample.payload.to_bytes()  # a robot reads it
            arrivals_ns.append(time.time_ns())

        return note


def rates_hz(arrivals_ns: Mapping[str, list[int]], begin_ns: int, end_ns: int) -> dict[str, float]:
    """Messages a second of each topic between two times of the wall clock."""
    seconds = (end_ns - begin_ns) / 1e9
    return {
        name: sum(begin_ns <= at_ns <= end_ns for at_ns in times) / seconds
        for name, times in arrivals_ns.items()
    }
