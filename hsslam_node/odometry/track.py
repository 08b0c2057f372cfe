"""Odometry messages, interpolated at the stamps of frames."""

import secrets
from collections import deque
from dataclasses import dataclass
from itertools import islice

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.pose_covariance import carried
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log
from hsslam_node.odometry.noise import USUAL_NOISE, growth, increase_of_motion, of_jump
from hsslam_node.odometry.reading import OdometryReading
from hsslam_node.sensor_watch import SensorWatch, StampOrder

_KEPT = 512  # poses: 5 s at 100 Hz
_LONGEST_S = 0.5  # between two poses: no reading in a longer gap, no motion across it
_AHEAD_S = 0.1  # after the newest pose: how late odometry may be
_LONGEST_AHEAD_S = 0.2  # likewise, of a slow source
_AHEAD_SHARE = 1.5  # of the time between two poses of a slow source: 10 Hz may be 0.05 s late
_SPEED_OVER_S = 0.05  # span of the motion that is extrapolated, as messages come in bursts
_FASTEST_M_S, _FASTEST_RAD_S = 10.0, 15.0  # a faster motion is a jump
_FARTHEST_M = 1e8  # from the origin of odom: more is no reading; UTM has 1e7
_LARGEST_VARIANCE = 1e12  # m^2, rad^2: whatever is larger says the same
_BURST_S = 0.02  # least time for a speed, as stamps of receipt come in bursts


@dataclass(frozen=True)
class _Pose:
    stamp_ns: int
    T_odom_cam: np.ndarray  # [4, 4]
    covariance: np.ndarray  # [6, 6] as of `OdometryReading`
    is_after_unknown: bool = False  # whether the motion to it is unknown


class OdometryTrack:
    """Poses of a robot's base, read as poses of its camera at any stamp near them.

    Poses are interpolated. After the newest pose the motion of the last 0.05 s continues for at most 0.1 s;
    that of poses farther apart for 1.5 times the time between them, at most 0.2 s. The covariance grows by
    `noise` and with the covariances of the poses. A jump is an unknown motion. So is the motion over a gap of
    more than 0.5 s, as the source may have restarted, and that since a clock was set back (`StampOrder`),
    which restarts the track. The readings of a track are a series of their own, so the motion since a reading
    of another track is unknown.

    Args:
        T_base_cam: [4, 4] the camera on the base.
        noise: standard deviation after 1 m (m) and after 1 rad (rad).
        watch: notices faults of the poses.
    """

    def __init__(
        self,
        T_base_cam: np.ndarray,
        noise: float = USUAL_NOISE,
        watch: SensorWatch | None = None,
    ) -> None:
        self._T_base_cam = T_base_cam
        self._noise = noise
        self._watch = SensorWatch() if watch is None else watch
        self._poses: deque[_Pose] = deque(maxlen=_KEPT)
        self._order = StampOrder()
        self._base_covariance = np.zeros((6, 6))  # covariance given with the newest pose
        self._base_m = np.zeros(3)  # position of the base in that pose
        self._series = secrets.randbits(62)

    def add(
        self, stamp_ns: int, T_odom_base: np.ndarray, covariance: np.ndarray | None = None
    ) -> bool:
        """Take a pose [4, 4]; False if it is left out, as its stamp is not after the newest.

        covariance: [6, 6] of translation (m) and of rotation (rad) about the base's centre, axes of odom.

        Raises:
            UserError: the position is not finite, or farther away than any on Earth.
        """
        if not np.abs(T_odom_base[:3, 3]).max() <= _FARTHEST_M:  # also if one is nan
            raise UserError(
                f"odometry: position {T_odom_base[:3, 3]}: expected at most {_FARTHEST_M:g} m"
            )
        T = T_odom_base @ self._T_base_cam
        base_covariance = np.zeros((6, 6)) if covariance is None else covariance
        base_covariance = base_covariance.clip(-_LARGEST_VARIANCE, _LARGEST_VARIANCE)
        if not self._poses:
            self._poses.append(_Pose(stamp_ns, T, np.zeros((6, 6))))
        elif back_s := self._order.set_back_s(stamp_ns, self._poses[-1].stamp_ns):
            unknown = self._poses[-1].covariance + of_jump()
            self._poses.clear()
            self._poses.append(_Pose(stamp_ns, T, unknown))
            self._watch.clock_set_back(back_s)
        elif stamp_ns <= self._poses[-1].stamp_ns:
            return False
        else:
            lever_m = T[:3, 3] - T_odom_base[:3, 3]
            jumps = self._jumps(stamp_ns, T)
            self._watch.moved(is_jump=jumps)
            is_unknown = jumps or stamp_ns - self._poses[-1].stamp_ns > 1e9 * _LONGEST_S
            doubt = of_jump() if is_unknown else growth(self._poses[-1].T_odom_cam, T, self._noise)
            step_m = T_odom_base[:3, 3] - self._base_m
            grown = increase_of_motion(self._base_covariance, base_covariance, step_m)
            doubt = doubt + carried(grown, lever_m)
            self._poses.append(_Pose(stamp_ns, T, self._poses[-1].covariance + doubt, is_unknown))
        self._base_covariance, self._base_m = base_covariance, T_odom_base[:3, 3].copy()
        return True

    def at(self, stamp_ns: int) -> OdometryReading | None:
        """The pose of the camera at this stamp; None if odometry does not know it."""
        reading = None if self._order.is_doubtful else self._at(stamp_ns)
        newest_ns = self._poses[-1].stamp_ns if self._poses else None
        self._watch.asked(stamp_ns, newest_ns, is_known=reading is not None)
        return reading

    def _at(self, stamp_ns: int) -> OdometryReading | None:
        before, after = None, None
        for pose in reversed(self._poses):
            if pose.stamp_ns <= stamp_ns:
                before = pose
                break
            after = pose
        if before is None:
            return None
        if before.stamp_ns == stamp_ns:
            return OdometryReading.at(before.T_odom_cam, before.covariance, self._series)
        if after is None:  # later than all
            return self._ahead(stamp_ns)
        return self._between(before, after, stamp_ns)

    def _ahead(self, stamp_ns: int) -> OdometryReading | None:
        newest, before = self._poses[-1], None
        after = newest
        for pose in islice(reversed(self._poses), 1, None):
            span_ns = newest.stamp_ns - pose.stamp_ns
            if after.is_after_unknown or span_ns > 1e9 * _LONGEST_S:
                break
            before = after = pose
            if span_ns >= 1e9 * _SPEED_OVER_S:
                break
        if before is None:
            return None
        span_s = 1e-9 * (newest.stamp_ns - before.stamp_ns)
        longest_s = min(max(_AHEAD_SHARE * span_s, _AHEAD_S), _LONGEST_AHEAD_S)
        if span_s < _BURST_S or stamp_ns - newest.stamp_ns > 1e9 * longest_s:
            return None
        return self._between(before, newest, stamp_ns)

    def _jumps(self, stamp_ns: int, T: np.ndarray) -> bool:
        """Whether the motion from the newest pose to this one is too fast for a robot."""
        newest = self._poses[-1]
        seconds = max(1e-9 * (stamp_ns - newest.stamp_ns), _BURST_S)
        twist = se3_log(inverse(newest.T_odom_cam) @ T)
        return bool(
            np.linalg.norm(twist[:3]) > _FASTEST_M_S * seconds
            or np.linalg.norm(twist[3:]) > _FASTEST_RAD_S * seconds
        )

    def _between(self, a: _Pose, b: _Pose, stamp_ns: int) -> OdometryReading | None:
        """The pose interpolated between two poses, or extrapolated beyond the second."""
        span_ns = b.stamp_ns - a.stamp_ns
        if span_ns > 1e9 * _LONGEST_S:
            return None
        share = (stamp_ns - a.stamp_ns) / span_ns
        T = a.T_odom_cam @ se3_exp(share * se3_log(inverse(a.T_odom_cam) @ b.T_odom_cam))
        return OdometryReading.at(
            T, a.covariance + share * (b.covariance - a.covariance), self._series
        )
