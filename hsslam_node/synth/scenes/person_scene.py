"""The scene of `synth:person`, the room with a person; apart from `person.py`, which is the body."""

from dataclasses import replace

import numpy as np

from hsslam_node.synth.scenes.person import Person
from hsslam_node.synth.scenes.room import build_room
from hsslam_node.synth.scenes.room_motion import hand_shake, upright_poses
from hsslam_node.synth.scenes.scene import Scene

_SIZE_M = (5.6, 4.6, 2.6)
_LENGTH = 600
_LINE_M = ((4.7, 2.22), (0.9, 2.22))


def build_person_scene(seed: int) -> Scene:
    """The room of `synth:room` at its usual size, with a person between camera and sofa."""
    return replace(build_room(_SIZE_M, seed), moving=Person(*_LINE_M, pace_m_s=0.7))


def person_scene_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4]: to and fro along the window, looking at the other side."""
    n = length or _LENGTH
    rng = np.random.default_rng((seed, 4))
    t = 2 * np.pi * np.arange(n) / _LENGTH
    x = 2.55 - 1.0 * np.cos(t)
    y = 1.42 - 0.10 * np.sin(2 * t)
    z = 1.42 + 0.06 * np.sin(2 * t + 1)
    yaw = np.deg2rad(98 + 30 * np.cos(t + 0.9))
    pitch = np.deg2rad(12 + 6 * np.sin(2 * t))
    shake = hand_shake(n, rng)
    position = np.column_stack([x, y, z]) + 0.0025 * shake[:, :3]
    yaw, pitch, roll = np.stack([yaw, pitch, 0 * t]) + np.deg2rad(0.2) * shake[:, 3:].T
    return upright_poses(position, yaw, pitch, roll)
