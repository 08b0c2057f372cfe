"""The scene of `synth:chair`; apart from `carried_off.py`, which removes the chair."""

from dataclasses import replace

import numpy as np

from hsslam_node.synth.parts.furniture import chair
from hsslam_node.synth.parts.placement import Placement
from hsslam_node.synth.scenes.carried_off import CarriedOff
from hsslam_node.synth.scenes.room import build_room
from hsslam_node.synth.scenes.room_motion import hand_shake, upright_poses
from hsslam_node.synth.scenes.scene import Scene

_SIZE_M = (5.6, 4.6, 2.6)
_LENGTH = 480  # to the right and back
_CHAIR = Placement(2.15, 2.25, -30)
_TOWARDS_CHAIR_DEG, _TURN_DEG = 151.0, 120.0


def build_chair_scene(seed: int) -> Scene:
    """The room of `synth:room` at its usual size, with a chair on the carpet for the first 8 s."""
    parts = _CHAIR.place(chair("wood:oak", "fabric:teal"))
    return replace(build_room(_SIZE_M, seed), moving=CarriedOff(parts, gone_from=_LENGTH // 2))


def chair_scene_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4]: from the chair's place to the bookshelf and back, again and again."""
    n = length or _LENGTH
    rng = np.random.default_rng((seed, 4))
    t = 2 * np.pi * np.arange(n) / _LENGTH
    x = 4.00 + 0.15 * np.sin(t)
    y = 1.45 + 0.12 * np.sin(2 * t)
    z = 1.42 + 0.06 * np.sin(2 * t + 1)
    yaw = np.deg2rad(_TOWARDS_CHAIR_DEG - _TURN_DEG * (1 - np.cos(t)) / 2)
    pitch = np.deg2rad(21 + 5 * np.sin(2 * t))
    shake = hand_shake(n, rng)
    position = np.column_stack([x, y, z]) + 0.0025 * shake[:, :3]
    yaw, pitch, roll = np.stack([yaw, pitch, 0 * t]) + np.deg2rad(0.2) * shake[:, 3:].T
    return upright_poses(position, yaw, pitch, roll)
