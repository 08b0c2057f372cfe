"""Other sensors of the robot, on the bus; apart as three paces name it."""

from collections.abc import Callable

from hsslam_node.frame import Frame
from hsslam_node.sources.reports import Report
from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.bus.imu_inlet import ImuInlet
from hsslam_services.bus.odometry_inlet import OdometryInlet
from hsslam_services.run.options import ServeOptions

_ODOMETRY_RING = 256  # messages: more than come between two frames
_IMU_RING = 2048


class RobotSensors:
    """Adds odometry and IMU readings to frames, if other programs send them."""

    def __init__(self, odometry: OdometryInlet, imu: ImuInlet) -> None:
        self._odometry = odometry
        self._imu = imu

    @classmethod
    def heard(
        cls, bus: Bus, options: ServeOptions, tell: Callable[[Report], None] = lambda _: None
    ) -> "RobotSensors":
        """Subscribe to both topics; `tell` gets reports of problems with their messages."""
        wheels = bus.subscribe(topics.ODOMETRY, _ODOMETRY_RING)
        return cls(
            OdometryInlet(wheels, options.base_T_camera, options.odometry_noise, tell),
            ImuInlet(bus.subscribe(topics.IMU, _IMU_RING), options.camera_T_imu, tell),
        )

    def given(self, frame: Frame, stamp_ns: int) -> Frame:
        """The frame with the readings of the sensors at this stamp, wall clock."""
        return self._imu.given(self._odometry.given(frame, stamp_ns), stamp_ns)
