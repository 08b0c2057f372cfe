"""IMU samples, integrated and read at the stamps of frames."""

from collections import deque
from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import so3_exp
from hsslam_node.inertial.reading import ImuReading
from hsslam_node.sensor_watch import SensorWatch, StampOrder

_KEPT = 2048  # samples: 2 s at 1 kHz
_LONGEST_NS = 100_000_000  # between two samples: a longer gap begins a new series
_AHEAD_NS = 60_000_000  # after the newest sample: batches of samples at 30 Hz may be 27 ms late
# in the year 2116: series, which are numbered by stamps, must fit into 63 bits
_LATEST_NS = 1 << 62
_FASTEST_RAD_S, _STRONGEST_M_S2 = 1e3, 1e5  # ten times what sensors measure: more is no reading


@dataclass(frozen=True)
class _State:
    """A sample, and the integrals up to it."""

    stamp_ns: int
    turn_rate: np.ndarray  # [3] rad/s, axes of the camera
    force: np.ndarray  # [3] m/s^2, likewise
    rotation: np.ndarray  # [3, 3] camera to series
    velocity: np.ndarray  # [3] m/s of the IMU, axes of the series
    series: int
    began_ns: int  # stamp of the first sample of the series


class ImuTrack:
    """Integrates angular velocity and specific force, and reads both at any stamp near the samples.

    Both are integrated by the trapezoidal rule, the force in axes that do not turn. After a gap of more than
    0.1 s, and after the clock was set back (`StampOrder`), a new series begins. The newest sample holds for
    at most 0.06 s.

    Args:
        T_cam_imu: [4, 4] the IMU in the camera's optical frame (x right, y down, z forward).
        watch: notices faults of the samples.
    """

    def __init__(
        self,
        T_cam_imu: np.ndarray | None = None,
        watch: SensorWatch | None = None,
    ) -> None:
        T = np.eye(4) if T_cam_imu is None else T_cam_imu
        self._R_cam_imu = T[:3, :3]
        self._lever_m = T[:3, 3]
        self._watch = SensorWatch() if watch is None else watch
        self._order = StampOrder()
        self._newest_series: int | None = None
        self._states: deque[_State] = deque(maxlen=_KEPT)

    def add(self, stamp_ns: int, angular_velocity: np.ndarray, acceleration: np.ndarray) -> bool:
        """Take a sample; False if it is left out, as its stamp is not after the newest.

        angular_velocity: [3] rad/s, axes of the IMU.
        acceleration: [3] m/s^2, as accelerometers have it: at rest 9.81, upwards.

        Raises:
            UserError: a number is not finite, or larger than any sensor measures; the stamp is no time.
        """
        if not 0 <= stamp_ns < _LATEST_NS:
            raise UserError(f"imu: stamp {stamp_ns}: expected 0 to 2^62 ns")
        is_turn = np.abs(angular_velocity).max() <= _FASTEST_RAD_S  # false if one is nan
        if not (is_turn and np.abs(acceleration).max() <= _STRONGEST_M_S2):
            raise UserError(
                f"imu: angular velocity {angular_velocity} rad/s, acceleration {acceleration} m/s^2: "
                f"expected at most {_FASTEST_RAD_S:g} and {_STRONGEST_M_S2:g}"
            )
        newest = self._states[-1] if self._states else None
        if newest is not None and (back_s := self._order.set_back_s(stamp_ns, newest.stamp_ns)):
            self._states.clear()
            self._watch.clock_set_back(back_s)
            newest = None
        if newest is not None and stamp_ns <= newest.stamp_ns:
            return False
        turn_rate, force = self._R_cam_imu @ angular_velocity, self._R_cam_imu @ acceleration
        if newest is None or stamp_ns - newest.stamp_ns > _LONGEST_NS:
            begin = (np.eye(3), np.zeros(3), self._next_series(stamp_ns), stamp_ns)
            self._states.append(_State(stamp_ns, turn_rate, force, *begin))
        else:
            self._states.append(_integrated(newest, stamp_ns, turn_rate, force))
        return True

    def _next_series(self, stamp_ns: int) -> int:
        """The number of a new series: its first stamp, or if stamps went back, the next free number."""
        before = self._newest_series
        self._newest_series = stamp_ns if before is None else max(stamp_ns, before + 1)
        return self._newest_series

    def at(self, stamp_ns: int) -> ImuReading | None:
        """The integrals up to this stamp, for the camera's centre; None: not known."""
        reading = None if self._order.is_doubtful else self._at(stamp_ns)
        newest_ns = self._states[-1].stamp_ns if self._states else None
        self._watch.asked(stamp_ns, newest_ns, is_known=reading is not None)
        return reading

    def _at(self, stamp_ns: int) -> ImuReading | None:
        after = None
        for state in reversed(self._states):
            if state.stamp_ns <= stamp_ns:
                return self._from(state, after, stamp_ns)
            after = state
        return None

    def _from(self, before: _State, after: _State | None, stamp_ns: int) -> ImuReading | None:
        if after is None and stamp_ns - before.stamp_ns > _AHEAD_NS:
            return None
        turn_rate, force = before.turn_rate, before.force
        if after is not None:
            if after.series != before.series:
                return None
            share = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
            turn_rate = turn_rate + share * (after.turn_rate - turn_rate)
            force = force + share * (after.force - force)
        here = _integrated(before, stamp_ns, turn_rate, force)
        of_lever = here.rotation @ np.cross(turn_rate, self._lever_m)
        seconds = 1e-9 * (stamp_ns - here.began_ns)
        return ImuReading.at(here.rotation, here.velocity - of_lever, seconds, here.series)


def _integrated(before: _State, stamp_ns: int, turn_rate: np.ndarray, force: np.ndarray) -> _State:
    seconds = 1e-9 * (stamp_ns - before.stamp_ns)
    R = before.rotation @ so3_exp(0.5 * seconds * (before.turn_rate + turn_rate))
    change = 0.5 * seconds * (before.rotation @ before.force + R @ force)
    velocity = before.velocity + change
    return _State(stamp_ns, turn_rate, force, R, velocity, before.series, before.began_ns)
