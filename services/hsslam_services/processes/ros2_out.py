"""The ROS 2 output process: publishes poses, transforms, path, points and grid to ROS 2, over rmw_zenoh.

It passes the pose of `/initialpose` on to the tracker, which looks for the camera there.

Subscribes: in/frame, out/pose, out/grid, out/esdf
Arena: reads keyframes, map_state, pose_log
"""

import time
from dataclasses import replace
from functools import partial

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.pose_log import PoseLog
from hsslam_proto import topics
from hsslam_proto.frame_codec import frame_from_message
from hsslam_proto.messages import Pose
from hsslam_proto.requests import LOCATE
from hsslam_proto.robot_motion import RobotPath
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap
from hsslam_services.launch.run_worker import run_worker
from hsslam_services.launch.worker import Worker
from hsslam_services.ros2.depth_points import depth_points
from hsslam_services.ros2.floor_out import FloorOut
from hsslam_services.ros2.initial_pose import InitialPose
from hsslam_services.ros2.keyframe_path import keyframe_path
from hsslam_services.ros2.messages import RosMessages
from hsslam_services.ros2.names import FrameNames, Qos
from hsslam_services.ros2.node import RosNode, RosPublisher
from hsslam_services.ros2.stamp_clock import StampClock
from hsslam_services.run.source_table import speaks_ros2
from hsslam_services.tracked.waiting_frames import WaitingFrames

_POLL_S = 0.1
_CONNECT_S = 1.0  # for a router to answer; delays the end of the run by at most this
_PATH_S, _POINTS_S = 1.0, 0.2  # between messages
_ROWS_A_POSE = 4096  # of the pose log that are read at once: 3 MB, some ms
_MOST_PATH_POSES = 1000  # 90 kB; 15 ms of one core
_MOST_POINTS = 20_000  # 320 kB


def main() -> None:
    run_worker("ros2_out", _run)


def _run(worker: Worker) -> None:
    options = worker.options
    messages = RosMessages(f"--ros2-out {options.ros2_out}")
    worker.ready()
    node = _connected(worker, messages)
    if node is None:
        return
    with node:
        poses = worker.bus.subscribe(topics.POSE, 64)
        out = Ros2Out(worker, node, messages)
        floor = _floor_out(worker, node, messages, out.names.map) if options.grid else None
        ask = partial(worker.bus.pass_on, LOCATE)
        initial = InitialPose(node, messages, out.names.map, ask, worker.event)
        while not worker.should_stop():
            if (pose := poses.wait(_POLL_S)) is not None:
                out.tell(pose)
            initial.hear()
            if floor is not None:
                floor.tell_news(out.frames.T_map_world)
        if floor is not None and out.is_given_up:
            floor.forget(out.frames.T_map_world)


def _connected(worker: Worker, messages: RosMessages) -> RosNode | None:
    """The node; waits for the router of ROS nodes, which may start later; None if the run ends first."""
    endpoint, options = worker.run.ros_endpoint, worker.options
    is_reported = False
    for _ in worker.tries():
        try:
            node = RosNode(
                endpoint, options.ros2.domain, options.ros2_out, "slam", messages, _CONNECT_S
            )
        except UserError as error:
            if not is_reported:
                worker.event("warning", f"{error}: no output to ROS 2 until it is there")
            is_reported = True
        else:
            if is_reported:
                worker.event("info", f"{endpoint}: connected to the router of ROS nodes")
            return node
    return None


def _floor_out(worker: Worker, node: RosNode, messages: RosMessages, frame: str) -> FloorOut:
    has_ros_stamps = speaks_ros2(worker.options.source)
    return FloorOut(worker.bus, node, messages, frame, has_ros_stamps=has_ros_stamps)


class Ros2Out:
    """Publishes poses, transforms, path and points; for a frame of a fragment all but its place in the map.

    It publishes nothing for another lost frame, so ROS sees old transforms.
    """

    def __init__(self, worker: Worker, node: RosNode, messages: RosMessages) -> None:
        self._worker = worker
        self._messages = messages
        self.names = FrameNames.of(worker.options.ros2_frame_prefix)
        self._robot = RobotFrames.mounted(worker.options.base_T_camera)
        self._has_ros_stamps = speaks_ros2(worker.options.source)
        self._motions = RobotPath(by_wall_clock=worker.options.has_other_rate)
        self._link = SharedMap(worker.arena, worker.options.slam)
        self._state = MapState(worker.run.arena_dir)
        self._max_depth_m = worker.options.slam.mapper.max_depth_m
        self._images: WaitingFrames | None = None
        self._clock = StampClock()
        self._log = PoseLog(worker.arena)
        self._learned = 0  # rows of the log
        self._last_ns: int | None = None  # stamp of the last published pose
        self._next_path_s = self._next_points_s = 0.0
        each, newest = Qos(10), Qos(1)
        self._odometry = node.publisher("odom", "nav_msgs/msg/Odometry", each)
        self._pose = node.publisher("pose", "geometry_msgs/msg/PoseWithCovarianceStamped", each)
        self._path = node.publisher("path", "nav_msgs/msg/Path", newest)
        self._points = node.publisher(
            "points", "sensor_msgs/msg/PointCloud2", Qos(5, is_reliable=False)
        )
        self._transforms: RosPublisher | None = None
        if worker.options.ros2_tf:
            self._transforms = node.publisher("/tf", "tf2_msgs/msg/TFMessage", Qos(100))
            static = node.publisher("/tf_static", "tf2_msgs/msg/TFMessage", Qos(1, is_latched=True))
            camera = (self.names.base, self.names.camera, self._robot.T_base_cam)
            static.put(messages.transforms(time.time_ns(), [camera]))

    @property
    def frames(self) -> RobotFrames:
        """The robot in the present world frame, which may be that of a loaded map."""
        store = self._link.store()
        return (
            replace(self._robot, T_level_world=store.world_frame.T_level_world)
            if store
            else self._robot
        )

    @property
    def is_given_up(self) -> bool:
        """Whether a reset of the map is about to come."""
        return self._state.is_given_up

    def tell(self, pose: Pose) -> None:
        """Publish a pose, and path and points if they are due."""
        is_past = pose.map_epoch != self._state.map_epoch  # of a frame that is sent again
        is_again = self._last_ns == self._stamp_ns(pose)
        if (pose.status == "lost" and not pose.fragment) or is_again or is_past:
            return
        with self._worker.timed("ros2"):
            self._publish_pose(pose)
            now_s = time.monotonic()
            is_path_due = now_s >= self._next_path_s and self._path.has_subscribers()
            if is_path_due and not pose.fragment and self._knows_all_stamps():
                self._next_path_s = now_s + _PATH_S
                self._publish_path(pose)
            is_due = now_s >= self._next_points_s and not pose.is_dead_reckoned
            if is_due and self._points.has_subscribers():
                self._publish_points(pose, now_s)
            elif is_due and self._images is not None:  # they cost time
                self._images.close()
                self._images = None

    def _publish_pose(self, pose: Pose) -> None:
        stamp_ns, make, names = self._stamp_ns(pose), self._messages, self.names
        self._last_ns = stamp_ns
        motion = self._motions.next(pose, self.frames)
        if self._transforms is not None:
            chain = [(names.odom, names.base, motion.T_odom_base)]
            if motion.T_map_odom is not None:
                chain.insert(0, (names.map, names.odom, motion.T_map_odom))
            self._transforms.put(make.transforms(stamp_ns, chain))
        if motion.T_map_base is not None:
            known = motion.covariance_in_map
            self._pose.put(make.pose(stamp_ns, names.map, motion.T_map_base, known))
        self._odometry.put(
            make.odometry(
                stamp_ns,
                (names.base, names.odom),
                motion.T_odom_base,
                motion.covariance_in_odom,
                np.zeros(6) if motion.twist is None else motion.twist,
                motion.twist_covariance,
            )
        )
        self._worker.count("poses")

    def _publish_path(self, pose: Pose) -> None:
        """Publish the keyframes at their present poses, thinned evenly."""
        store = self._link.store()
        if store is None or store.count == 0:
            return
        stamp_ns = self._stamp_ns(pose)
        path = keyframe_path(store, self.frames, self._clock, stamp_ns, _MOST_PATH_POSES)
        self._path.put(self._messages.path(stamp_ns, self.names.map, *path))

    def _knows_all_stamps(self) -> bool:
        """Learn both stamps of some more frames, also of those that this process did not hear; True: of all.

        After hours the first subscriber of the path waits for seconds; transforms and poses go on.
        """
        if self._has_ros_stamps:
            return True
        count = self._log.count
        learned = min(self._learned + _ROWS_A_POSE, count)
        for rows in self._log.slabs(range(self._learned, learned)):
            both = zip(rows["source_stamp_ns"].tolist(), rows["stamp_ns"].tolist(), strict=True)
            for source_ns, ros_ns in both:
                self._clock.learn(source_ns, ros_ns)
        self._learned = learned
        return learned == count

    def _publish_points(self, pose: Pose, now_s: float) -> None:
        """Publish the points of this pose's image in the camera's frame.

        A costmap clears the space between the origin of a cloud's frame and its points.
        """
        if self._images is None:  # receive images only from the first subscriber on
            self._images = WaitingFrames(self._worker.bus)
        message = self._images.of(pose)
        if message is None:
            return
        points, colors = depth_points(frame_from_message(message), _MOST_POINTS, self._max_depth_m)
        if not len(points):  # for a robot, an empty cloud means free space
            return
        self._next_points_s = now_s + _POINTS_S
        cloud = self._messages.cloud(self._stamp_ns(pose), self.names.camera, points, colors)
        self._points.put(cloud)

    def _stamp_ns(self, pose: Pose) -> int:
        """The time of the image, on the clock of ROS."""
        return pose.source_stamp_ns if self._has_ros_stamps else pose.stamp_ns


if __name__ == "__main__":
    main()
