"""Adds odometry from `in/odometry` to the frames of the camera; apart as two paces use it."""

from collections.abc import Callable, Sequence
from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.odometry.track import OdometryTrack
from hsslam_node.sources.reports import Report, sensor_watch
from hsslam_proto.messages import RobotOdometry
from hsslam_proto.pose_codec import covariance_matrix, pose_matrix
from hsslam_services.bus.subscription import Subscription


class OdometryInlet:
    """Interpolates odometry at the stamps of frames. Stamps are wall clock, as `stamp_ns` of frames.

    Args:
        base_T_camera: numbers of `--base-T-camera`.
        noise: as in `OdometryTrack`.
        tell: gets a report of each message that is no reading, and of faults of the stamps.
    """

    def __init__(
        self,
        messages: Subscription[RobotOdometry],
        base_T_camera: Sequence[float],
        noise: float,
        tell: Callable[[Report], None] = lambda _: None,
    ) -> None:
        self._messages, self._tell = messages, tell
        self._track = OdometryTrack(
            RobotFrames.mounted(base_T_camera).T_base_cam,
            noise,
            sensor_watch(messages.topic.name, tell),
        )

    def given(self, frame: Frame, stamp_ns: int) -> Frame:
        """The frame with the odometry at this stamp; unchanged if it has odometry or there is none."""
        for message in self._messages.drain():
            T_odom_base = pose_matrix([*message.t, *message.q])
            covariance = covariance_matrix(message.covariance)
            try:
                self._track.add(message.stamp_ns, T_odom_base, covariance)
            except UserError as error:
                self._tell(Report.unusable(self._messages.topic.name, error))
        reading = None if frame.odometry is not None else self._track.at(stamp_ns)
        return frame if reading is None else replace(frame, odometry=reading)
