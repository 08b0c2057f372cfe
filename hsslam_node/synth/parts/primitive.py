"""What scenes are made of: boxes, cylinders and ellipsoids, each with textured faces."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np


class Kind(IntEnum):
    """Shape of a primitive in its unit frame."""

    ROOM = 0  # the cube [-1, 1]^3 seen from inside
    BOX = 1  # the cube [-1, 1]^3
    CYLINDER = 2  # x^2 + y^2 <= 1, |z| <= 1
    ELLIPSOID = 3  # the unit ball


HIDDEN = "hidden"
"""Material of a face that no camera can see."""

FACE_COUNT = {Kind.ROOM: 6, Kind.BOX: 6, Kind.CYLINDER: 3, Kind.ELLIPSOID: 1}


@dataclass(frozen=True)
class Primitive:
    """A unit shape scaled by `half_m`, rotated by `rotation`, moved to `center_m` (m, world, z up).

    Faces: cubes +x -x +y -y +z -z; cylinders side, top, bottom; ellipsoids one. `materials` names
    the texture of every face, or one for all.
    """

    kind: Kind
    center_m: np.ndarray  # [3]
    half_m: np.ndarray  # [3]
    rotation: np.ndarray  # [3, 3], to world
    materials: tuple[str, ...]

    @property
    def face_count(self) -> int:
        return FACE_COUNT[self.kind]

    def material(self, face: int) -> str:
        """The texture of a face."""
        return self.materials[face % len(self.materials)]

    def face_size_m(self, face: int) -> tuple[float, float]:
        """Width (along u) and height (along v) of a face, m."""
        hx, hy, hz = (float(h) for h in self.half_m)
        if self.kind in (Kind.ROOM, Kind.BOX):
            return ((2 * hy, 2 * hz), (2 * hx, 2 * hz), (2 * hx, 2 * hy))[face // 2]
        round_m = np.pi * (hx + hy)
        if self.kind == Kind.CYLINDER:
            return (round_m, 2 * hz) if face == 0 else (2 * hx, 2 * hy)
        return round_m, np.pi * hz

    def surface(self, face: int, u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World points [..., 3] m and unit normals [..., 3] at texture coordinates in [0, 1]."""
        unit, normal = _unit_surface(self.kind, face, u, v)
        normal = normal / self.half_m
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return (unit * self.half_m) @ self.rotation.T + self.center_m, normal @ self.rotation.T


def _unit_surface(
    kind: Kind, face: int, u: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The inverse of the texture coordinates that the ray caster computes."""
    zero, one = np.zeros_like(u), np.ones_like(u)
    if kind in (Kind.ROOM, Kind.BOX):
        a, b = 2 * u - 1, 1 - 2 * v
        sign = 1.0 if face % 2 == 0 else -1.0
        points = (
            np.stack([sign * one, a, b], -1),
            np.stack([a, sign * one, b], -1),
            np.stack([a, b, sign * one], -1),
        )[face // 2]
        normal = np.zeros(3)
        normal[face // 2] = sign if kind == Kind.BOX else -sign
        return points, np.broadcast_to(normal, points.shape)
    azimuth = (2 * u - 1) * np.pi
    x, y = np.cos(azimuth), np.sin(azimuth)
    if kind == Kind.CYLINDER:
        if face == 0:
            return np.stack([x, y, 1 - 2 * v], -1), np.stack([x, y, zero], -1)
        sign = 1.0 if face == 1 else -1.0
        points = np.stack([2 * u - 1, 1 - 2 * v, sign * one], -1)
        return points, np.broadcast_to(np.array([0.0, 0.0, sign]), points.shape)
    polar = v * np.pi
    points = np.stack([np.sin(polar) * x, np.sin(polar) * y, np.cos(polar)], -1)
    return points, points


def rotation_z(angle_deg: float, lean_deg: float = 0.0) -> np.ndarray:
    """Rotation [3, 3]: lean about x first, then turn about z."""
    a, b = np.deg2rad(angle_deg), np.deg2rad(lean_deg)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    lean = np.array([[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])
    return turn @ lean
