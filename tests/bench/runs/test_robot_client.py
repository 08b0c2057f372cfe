"""What a robot beside a run takes, and how often."""

import time

from hsslam_bench.runs.robot_client import AttachedRobot, rates_hz
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus, free_endpoint
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.run.run_info import RunInfo
from tests.services.wire_samples import grid
from tests.until import until


def test_messages_of_the_run_and_of_ros_arrive(run_info: RunInfo):
    ros_router = free_endpoint()
    robot = AttachedRobot(run_info.path, ros_router)
    try:
        run_info.write()
        with Bus(run_info.endpoint, "robot", "distances") as bus, open_client(ros_router) as ros:
            robot.poll()
            grids, before_ns = bus.publisher(topics.GRID), time.time_ns()
            odometry = ros.declare_publisher("0/hsslam/odom/kind/hash")
            until(grids.has_subscribers)
            until(lambda: odometry.matching_status.matching)
            for index in range(3):
                grids.put(grid(index))
            odometry.put(b"a message")
            until(lambda: _counts(robot) == {"out/grid": 3, "ros:odom": 1})
            rates = rates_hz(robot.found()["arrivals_ns"], before_ns, before_ns + 10**11)
            assert (rates["out/grid"], rates["ros:odom"], rates["ros:map"]) == (0.03, 0.01, 0.0)
    finally:
        robot.close()


def _counts(robot: AttachedRobot) -> dict[str, int]:
    arrivals_ns = robot.found()["arrivals_ns"]
    return {name: len(times) for name, times in arrivals_ns.items() if times}
