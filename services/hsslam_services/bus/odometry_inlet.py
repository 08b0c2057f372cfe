"""Odometry on `in/odometry` for the frames of this run's camera; apart, as two paces of the camera use it."""

from collections.abc import Sequence
from dataclasses import replace

from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.odometry.track import OdometryTrack
from hsslam_proto.messages import RobotOdometry
from hsslam_proto.pose_codec import covariance_matrix, pose_matrix
from hsslam_services.bus.subscription import Subscription


class OdometryInlet:
    """Takes what has come before each frame. Stamps are of the wall clock, as `stamp_ns` of frames.

    Args:
        base_T_camera: numbers of `--base-T-camera`, where the camera is on what the odometry is of.
        noise: of odometry, as in `OdometryTrack`.
    """

    def __init__(
        self,
        messages: Subscription[RobotOdometry],
        base_T_camera: Sequence[float],
        noise: float,
    ) -> None:
        self._messages = messages
        self._track = OdometryTrack(RobotFrames.mounted(base_T_camera).T_base_cam, noise)

    def given(self, frame: Frame, stamp_ns: int) -> Frame:
        """The frame with what odometry says at this stamp; as it is if it has its own, or there is none."""
        for message in self._messages.drain():
            T_odom_base = pose_matrix([*message.t, *message.q])
            self._track.add(message.stamp_ns, T_odom_base, covariance_matrix(message.covariance))
        reading = None if frame.odometry is not None else self._track.at(stamp_ns)
        return frame if reading is None else replace(frame, odometry=reading)
