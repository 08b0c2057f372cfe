"""A person who walks to and fro along a line: a body of ellipsoids with swinging limbs."""

from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.synth.parts.placement import ball, box, cylinder
from hsslam_node.synth.parts.primitive import Primitive, rotation_z

_HIP_M, _THIGH_M, _SHOULDER_M, _UPPER_ARM_M = 0.90, 0.43, 1.43, 0.30
_STRIDE_M = 1.35  # two steps
_RATE_HZ = 30.0
_TURN_S = 1.2


@dataclass(frozen=True)
class Person:
    """Walks from `start_m` to `end_m` [2], turns, walks back, and so on; 1.75 m tall."""

    start_m: tuple[float, float]
    end_m: tuple[float, float]
    pace_m_s: float = 0.7

    def at(self, frame: int) -> list[Primitive]:
        """The body at a frame of 30 Hz: the same primitives, turned and moved."""
        start, way = np.array(self.start_m), np.subtract(self.end_m, self.start_m)
        length = float(np.linalg.norm(way))
        leg_s = length / self.pace_m_s
        lap, within_s = divmod(frame / _RATE_HZ, leg_s + _TURN_S)
        done = min(within_s / leg_s, 1.0)
        turned = np.clip((within_s - leg_s) / _TURN_S, 0.0, 1.0)
        turned = turned * turned * (3 - 2 * turned)
        is_back = lap % 2 == 1
        position = start + way * (1 - done if is_back else done)
        heading = np.rad2deg(np.arctan2(way[1], way[0])) - 90 + 180 * (turned + is_back)
        walked = lap * (length + 0.25) + done * length + 0.25 * turned
        return _placed(_body(2 * np.pi * walked / _STRIDE_M), position, heading)


def _placed(parts: list[Primitive], position: np.ndarray, heading_deg: float) -> list[Primitive]:
    turn, origin = rotation_z(heading_deg), np.array([*position, 0.0])
    return [
        replace(p, center_m=turn @ p.center_m + origin, rotation=turn @ p.rotation) for p in parts
    ]


def _body(phase: float) -> list[Primitive]:
    """All parts, feet on the floor, looking to +y, at a phase (rad) of the gait."""
    bob = 0.015 * np.cos(2 * phase)
    lift = np.array([0, 0, bob])
    parts = [
        ball((0, 0.00, 0.97), (0.175, 0.125, 0.15), "fabric:navy"),
        ball((0, 0.00, 1.12), (0.180, 0.120, 0.20), "fabric:mustard"),
        ball((0, 0.00, 1.30), (0.205, 0.130, 0.22), "fabric:mustard"),
        cylinder((0, 0.01, 1.51), 0.055, 0.12, "paint:skin"),
        ball((0, 0.02, 1.62), (0.078, 0.098, 0.120), "paint:skin"),
        ball((0, -0.01, 1.655), (0.086, 0.098, 0.105), "leaves:walnut"),
        ball((0, 0.12, 1.605), (0.014, 0.020, 0.024), "paint:skin"),
        box((0, -0.16, 1.25), (0.28, 0.14, 0.40), "fabric:teal"),  # a rucksack
    ]
    parts = [replace(p, center_m=p.center_m + lift) for p in parts]
    for side in (-1, 1):
        swing = side * np.sin(phase)
        bent = 40 * max(0.0, side * np.cos(phase)) + 6
        hip = (side * 0.095, 0.0, _HIP_M + bob)
        parts += _limb(hip, 24 * swing, -bent, _leg(_THIGH_M), _THIGH_M)
        shoulder = (side * 0.22, 0.0, _SHOULDER_M + bob)
        parts += _limb(shoulder, -22 * swing, 22 + 10 * swing, _arm(_UPPER_ARM_M), _UPPER_ARM_M)
    return parts


def _limb(
    joint,
    swing_deg: float,
    bend_deg: float,
    bones: tuple[list[Primitive], list[Primitive]],
    upper_m,
) -> list[Primitive]:
    """Upper and lower half of a limb that hangs from a joint, swung forward and bent in its middle."""
    upper, lower = _about_x(swing_deg), _about_x(swing_deg + bend_deg)
    middle = np.array(joint) + upper @ np.array([0, 0, -upper_m])
    turned = []
    for bone, turn, origin in ((bones[0], upper, np.array(joint)), (bones[1], lower, middle)):
        for p in bone:
            at = turn @ p.center_m + origin
            turned.append(replace(p, center_m=at, rotation=turn @ p.rotation))
    return turned


def _leg(thigh_m: float) -> tuple[list[Primitive], list[Primitive]]:
    return (
        [ball((0, 0, -thigh_m / 2), (0.085, 0.095, thigh_m / 2 + 0.06), "fabric:navy")],
        [
            ball((0, 0, -0.20), (0.062, 0.070, 0.25), "fabric:navy"),
            ball((0, 0.05, -0.43), (0.050, 0.135, 0.045), "stone:charcoal"),
        ],
    )


def _arm(upper_m: float) -> tuple[list[Primitive], list[Primitive]]:
    return (
        [ball((0, 0, -upper_m / 2), (0.052, 0.058, upper_m / 2 + 0.05), "fabric:mustard")],
        [
            ball((0, 0, -0.12), (0.042, 0.046, 0.16), "fabric:mustard"),
            ball((0, 0.01, -0.30), (0.034, 0.046, 0.075), "paint:skin"),
        ],
    )


def _about_x(angle_deg: float) -> np.ndarray:
    """Rotation [3, 3] that swings what hangs down to +y."""
    return rotation_z(0.0, angle_deg)
