"""The example that drives from Nav2, with messages of a run, of a plan and of commands that are replayed."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from hsslam_node.geometry.se3 import se3_exp
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import TopicName
from tests.in_process import run_script
from tests.repository import ROOT
from tests.until import until

_EXAMPLE = ROOT / "examples/drive_from_nav2.py"
_STORE = get_typestore(Stores.ROS2_KILTED)  # not the release of the example
_MESSAGES = RosMessages("test")
_CELL_M = 0.05


def _floor() -> np.ndarray:
    """3 x 4 m of free floor; a wall along y at x = 2 m, whose upper end, y = 2 m, lies in unknown space."""
    cells = np.zeros((60, 80), np.int8)
    cells[:40, 40] = 100
    cells[40:, 35:] = -1
    return cells


def _at(x: float, y: float, yaw: float = 0.0) -> np.ndarray:
    T = se3_exp(np.array([0, 0, 0, 0, 0, yaw]))
    T[:2, 3] = x, y
    return T


class _Nav2:
    """Sends what a run and Nav2 send, in order, and reads what the example says at each command."""

    def __init__(self, endpoint: str, example: "subprocess.Popen[str]") -> None:
        self._session = open_client(endpoint)
        self._stdout: Any = example.stdout
        commands = self._session.declare_publisher(self._key("/cmd_vel", "geometry_msgs/msg/Twist"))
        until(lambda: commands.matching_status.matching, 60)

    def send(self, topic: str, message: Any) -> None:
        kind = message.__msgtype__
        self._session.put(
            self._key(topic, kind),
            bytes(_STORE.serialize_cdr(message, kind)),
            congestion_control=zenoh.CongestionControl.BLOCK,
        )

    def plan(self, *corners: tuple[float, float], frame: str = "map") -> None:
        poses = np.stack([_at(*corner) for corner in corners])
        self.send("/plan", _MESSAGES.path(1, frame, [1] * len(corners), poses))

    def at(self, T_map_base: np.ndarray) -> None:
        self.send("/one/pose", _MESSAGES.pose(1, "map", T_map_base, None))

    def line(self, *, is_stamped: bool = False) -> str:
        """What it prints at a command."""
        new = _STORE.types
        linear, angular = (
            new["geometry_msgs/msg/Vector3"](x, 0.0, z) for x, z in ((0.2, 0.0), (0.0, -0.5))
        )
        command = new["geometry_msgs/msg/Twist"](linear, angular)
        if is_stamped:
            stamp = new["builtin_interfaces/msg/Time"](1, 0)
            header = new["std_msgs/msg/Header"](stamp, "base_link")
            command = new["geometry_msgs/msg/TwistStamped"](header, command)
        self.send("/cmd_vel", command)
        return self._stdout.readline()

    def close(self) -> None:
        self._session.close()

    @staticmethod
    def _key(topic: str, kind: str) -> str:
        return TopicName(topic, kind, _STORE.hash_rihs01(kind)).key(7)


@pytest.fixture
def nav2(endpoint) -> Iterator[_Nav2]:
    command = [sys.executable, _EXAMPLE, endpoint, "/one"]
    env = os.environ | {"ROS_DOMAIN_ID": "7"}
    with subprocess.Popen(command, env=env, stdout=subprocess.PIPE, text=True) as example:
        nav2 = _Nav2(endpoint, example)
        yield nav2
        nav2.close()
        example.terminate()


def test_a_plan_has_room_or_goes_through_the_wall(nav2):
    # the grid begins at (-1, 0) in `map`
    grid = _MESSAGES.occupancy_grid(1, "map", _CELL_M, _at(-1.0, 0.0), _floor())
    until(lambda: nav2.send("/one/map", grid) or "no map yet" not in nav2.line(), 60)
    assert "no pose in map yet; command 0.20 m/s -0.50 rad/s" in nav2.line()

    def line(**fields) -> str:
        nav2.send("/one/map", grid)  # both are new
        nav2.at(_at(-0.3, 1.0, 0.5))
        return nav2.line(**fields)

    assert line().startswith("at -0.30 1.00 m, 29 deg; no plan; command 0.20 m/s")
    free = ("is free", pytest.approx(0.625, abs=0.01))
    nav2.plan((-0.275, 1.025), (0.375, 1.025))  # the wall begins at x = 1 m in `map`
    assert _told(line(is_stamped=True)) == free
    nav2.plan((-5.025, 1.025), (-0.275, 1.025), (0.375, 1.025))  # the way behind does not count
    assert _told(line()) == free
    nav2.plan((-0.275, 1.025), (2.025, 1.025))
    assert _told(line()) == ("crosses 1 occupied cells", 0.0)
    nav2.plan((-0.275, 1.025), (0.375, 1.025), (0.375, 2.525), (0.925, 2.525))
    assert _told(line()) == ("crosses 4 unknown cells", 0.0)
    nav2.plan((-0.275, 1.025), (3.175, 1.025))  # out of the grid
    assert _told(line()) == ("crosses 1 occupied, 4 unknown cells", 0.0)
    nav2.plan((0.0, 0.0), (1.0, 0.0), frame="odom")
    assert "; plan in odom: expected map; " in line()


def test_what_is_old_is_not_told_as_the_present(nav2):
    """A lost camera has no pose, and a run that hangs sends no map; commands of Nav2 go on."""
    grid = _MESSAGES.occupancy_grid(1, "map", _CELL_M, _at(-1.0, 0.0), _floor())
    until(lambda: nav2.send("/one/map", grid) or "no map yet" not in nav2.line(), 60)
    nav2.at(_at(-0.3, 1.0))
    assert nav2.line().startswith("at -0.30 1.00 m")
    until(lambda: nav2.send("/one/map", grid) or nav2.line().startswith("pose is 1 s old"), 60)
    nav2.at(_at(-0.2, 1.0))
    assert nav2.line().startswith("at -0.20 1.00 m")
    until(lambda: nav2.at(_at(-0.2, 1.0)) or nav2.line().startswith("map is 1 s old"), 60)


def test_no_router_and_bad_input_are_one_line(endpoint):
    for words, told in (
        (["tcp/127.0.0.1:1"], "tcp/127.0.0.1:1: no router: expected hsslam-serve"),
        (["127.0.0.1:1"], "127.0.0.1:1: no router: expected hsslam-serve"),
        ([endpoint, "/one", "many"], "many: expected a number of commands"),
    ):
        done = run_script(_EXAMPLE, *words)
        assert done.returncode == 1 and told in done.stderr and done.stderr.count("\n") == 1


def _told(line: str) -> tuple[str, float]:
    """What the plan crosses, and the clearance, m."""
    found = re.search(r"; plan (.*), clearance (\S+) m; command 0.20 m/s -0.50 rad/s$", line)
    assert found, line
    return found[1], float(found[2])
