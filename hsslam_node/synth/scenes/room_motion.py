"""Motion of a hand-held camera: level poses, the shake of a hand, and the loop through the room."""

import numpy as np


def upright_poses(
    position: np.ndarray, yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray
) -> np.ndarray:
    """Camera-to-world poses [N, 4, 4] from positions [N, 3] and heading about z, look-down, roll, rad."""
    forward = np.stack(
        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)], axis=-1
    )
    level = np.stack([np.sin(yaw), -np.cos(yaw), np.zeros_like(yaw)], axis=-1)
    down = np.cross(forward, level)
    c, s = np.cos(roll)[:, None], np.sin(roll)[:, None]
    T = np.zeros((len(yaw), 4, 4))
    T[:, :3, 0] = c * level + s * down
    T[:, :3, 1] = c * down - s * level
    T[:, :3, 2] = forward
    T[:, :3, 3] = position
    T[:, 3, 3] = 1.0
    return T


def hand_shake(length: int, rng: np.random.Generator) -> np.ndarray:
    """Six smooth, periodic channels [length, 6] of about unit size: sines of 0.3 to 2.3 Hz."""
    t = np.arange(length)[:, None] / length
    total = np.zeros((length, 6))
    for period_frames in (90, 55, 34, 21, 13):
        cycles = max(1, round(length / period_frames))
        amplitude = (period_frames / 90) ** 1.1
        total += amplitude * np.sin(2 * np.pi * (cycles * t + rng.uniform(0, 1, (1, 6))))
    return total / 1.5


_LOOP_FRAMES = 600  # a loop at walking pace of a scanning hand: under 0.7 degrees a frame at 30 Hz
_SHAKE_MM, _SHAKE_DEG = 2.5, 0.20
_EYE_M = 1.35
_PITCH_DEG, _PITCH_SWING_DEG = 17.0, 8.0
_START_DEG = 78.0  # towards the sofa and the bookshelf
_BEHIND_RAD = 1.9  # the camera stands beside and a little behind the centre of what it looks at


def hand_held_poses(size_m: tuple[float, float, float], length: int, seed: int) -> np.ndarray:
    """Camera-to-world poses [length, 4, 4] on a closed loop that looks at all walls, smooth.

    A loop takes about 600 frames: longer sequences go round more often, shorter ones go out and
    back, so the speed stays that of a hand (up to 1.5 cm and 0.7 degrees a frame).
    """
    rng = np.random.default_rng((seed, 4))
    progress = _progress(length)  # [N] turns
    angle = 2 * np.pi * progress
    start = np.deg2rad(_START_DEG)
    room_x, room_y = size_m[0] / 2, size_m[1] / 2
    # the higher harmonics keep the ellipse from being one
    phase = rng.uniform(0, 2 * np.pi, 4)
    reach = 1 + 0.10 * np.sin(2 * angle + phase[0]) + 0.05 * np.sin(3 * angle + phase[1])
    x = room_x + _clearance(size_m[0]) * reach * np.cos(angle + start + _BEHIND_RAD)
    y = room_y + _clearance(size_m[1]) * reach * np.sin(angle + start + _BEHIND_RAD)
    z = _EYE_M + 0.07 * np.sin(2 * angle + phase[2])
    yaw = start + angle + 0.05 * np.sin(2 * angle + phase[3])
    pitch = np.deg2rad(_PITCH_DEG + _PITCH_SWING_DEG * np.sin(2 * angle + phase[0]))
    roll = np.deg2rad(1.5) * np.sin(3 * angle + phase[1])
    shake = hand_shake(length, rng)
    position = np.column_stack([x, y, z]) + 1e-3 * _SHAKE_MM * shake[:, :3]
    yaw, pitch, roll = np.stack([yaw, pitch, roll]) + np.deg2rad(_SHAKE_DEG) * shake[:, 3:].T
    return upright_poses(position, yaw, pitch, roll)


def _clearance(side_m: float) -> float:
    """Half axis of the loop: half the room, less furniture and a metre of view."""
    return float(np.clip(side_m / 2 - 1.4, 0.5, 1.25))


def _progress(length: int) -> np.ndarray:
    """Turns of the loop at every frame; the step after the last frame closes it."""
    k = np.arange(length) / length
    if length >= 0.75 * _LOOP_FRAMES:
        return k * max(1, round(length / _LOOP_FRAMES))
    far = length / _LOOP_FRAMES / np.pi  # out and back, never faster than the loop
    return far * (1 - np.cos(2 * np.pi * k)) / 2
