"""A person with a camera who walks along a closed way."""

import numpy as np

from hsslam_node.synth.scenes.room_motion import upright_poses

_RATE_HZ = 30.0
_PACE_M_S = 0.95  # straight on; slower in bends
_BEND_M = 0.30
_ROUNDING_M = 0.32  # how far corners of the way are rounded off
_LOOK_AHEAD_M = 1.1
_GAZE_S = 0.5
_EYE_M, _PITCH_DEG = 1.45, 13.0
_CELL_M = 0.01


def walk_poses(waypoints_m: np.ndarray, length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4] at 30 Hz along the closed way through waypoints [M, 2], m.

    One round without a `length`; longer walks go round again, shorter ones end on the way. The
    camera looks along the way and a little around, and sways with the steps.
    """
    way = _rounded(waypoints_m)  # [K, 2]
    cells = _paced(way)  # [N]
    position, ahead = _at(way, cells), _at(way, cells + _LOOK_AHEAD_M / _CELL_M)
    n = len(cells)
    t = np.arange(n) / n
    yaw = np.unwrap(np.arctan2(ahead[:, 1] - position[:, 1], ahead[:, 0] - position[:, 0]))
    turns = np.round((2 * yaw[-1] - yaw[-2] - yaw[0]) / (2 * np.pi))  # of one round
    straight = 2 * np.pi * turns * t
    yaw = _smooth(yaw - straight, _GAZE_S * _RATE_HZ) + straight
    rng = np.random.default_rng((seed, 4))
    yaw = yaw + np.deg2rad(8 * _sway(t, 6.3, rng) + 3 * _sway(t, 2.8, rng))
    pitch = np.deg2rad(_PITCH_DEG + 4 * _sway(t, 8.0, rng) + 0.4 * _sway(t, 1.1, rng))
    roll = np.deg2rad(1.0 * _sway(t, 4.6, rng) + 0.3 * _sway(t, 1.1, rng))
    aside = 0.012 * _sway(t, 1.1, rng)[:, None]  # a step with each foot takes 1.1 s
    eye = _EYE_M + 0.008 * _sway(t, 0.55, rng) + 0.03 * _sway(t, 13.0, rng)
    position = position + aside * np.column_stack([-np.sin(yaw), np.cos(yaw)])
    poses = upright_poses(np.column_stack([position, eye]), yaw, pitch, roll)
    return poses if length is None else poses[np.arange(length) % n]


def _rounded(waypoints_m: np.ndarray) -> np.ndarray:
    """The closed polygon as points [K, 2] one cell apart, its corners rounded off."""
    line = _smooth(_resampled(waypoints_m), _ROUNDING_M / _CELL_M)
    return _resampled(line)


def _resampled(ring: np.ndarray) -> np.ndarray:
    closed = np.vstack([ring, ring[:1]])
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0, s[-1], round(s[-1] / _CELL_M), endpoint=False)
    return np.column_stack([np.interp(at, s, closed[:, 0]), np.interp(at, s, closed[:, 1])])


def _paced(way: np.ndarray) -> np.ndarray:
    """Where on the way, in cells, the walker is at every frame of one round [N]."""
    step = (np.roll(way, -1, axis=0) - np.roll(way, 1, axis=0)) / 2
    heading = np.arctan2(step[:, 1], step[:, 0])
    bend = np.abs(np.angle(np.exp(1j * (np.roll(heading, -1) - heading)))) / _CELL_M  # 1/m
    slowness = _smooth((1 + _BEND_M * bend) / _PACE_M_S, 0.3 / _CELL_M)  # s/m
    time = np.concatenate([[0], np.cumsum(slowness * _CELL_M)])
    frames = round(time[-1] * _RATE_HZ)
    return np.interp(np.arange(frames) * (time[-1] / frames), time, np.arange(len(time)))


def _at(way: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Points [N, 2] on the ring of points."""
    low = np.floor(cells).astype(int)
    part = (cells - low)[:, None]
    return way[low % len(way)] * (1 - part) + way[(low + 1) % len(way)] * part


def _smooth(ring: np.ndarray, sigma: float) -> np.ndarray:
    """A periodic signal [N] or [N, C] after a Gaussian of `sigma` samples."""
    frequency = np.fft.rfftfreq(len(ring)).reshape(-1, *[1] * (ring.ndim - 1))
    kernel = np.exp(-2 * (np.pi * sigma * frequency) ** 2)
    return np.fft.irfft(np.fft.rfft(ring, axis=0) * kernel, len(ring), axis=0)


def _sway(t: np.ndarray, period_s: float, rng: np.random.Generator) -> np.ndarray:
    """A sine of about this period with a phase of its own; whole cycles in one round."""
    cycles = max(1, round(len(t) / (period_s * _RATE_HZ)))
    return np.sin(2 * np.pi * (cycles * t + rng.uniform()))
