"""Placement of furniture, and short names for the shapes it is made of."""

from dataclasses import dataclass, replace

import numpy as np

from hsslam_node.synth.parts.primitive import Kind, Primitive, rotation_z


@dataclass(frozen=True)
class Placement:
    """Position of a piece (m), and turn of its front from +y (degrees about z)."""

    x: float
    y: float
    angle_deg: float = 0.0
    z: float = 0.0

    def place(self, pieces: list[Primitive]) -> list[Primitive]:
        """The pieces in world coordinates."""
        turn = rotation_z(self.angle_deg)
        origin = np.array([self.x, self.y, self.z])
        return [
            replace(p, center_m=turn @ p.center_m + origin, rotation=turn @ p.rotation)
            for p in pieces
        ]


def box(center, size, *materials: str, angle_deg: float = 0.0, lean_deg: float = 0.0) -> Primitive:
    """A box by its centre and full size, m."""
    half = np.array(size, float) / 2
    return Primitive(
        Kind.BOX, np.array(center, float), half, rotation_z(angle_deg, lean_deg), materials
    )


def cylinder(center, radius: float, height: float, *materials: str) -> Primitive:
    """An upright cylinder by its centre, m."""
    half = np.array([radius, radius, height / 2])
    return Primitive(Kind.CYLINDER, np.array(center, float), half, np.eye(3), materials)


def ball(center, half, *materials: str, angle_deg: float = 0.0) -> Primitive:
    """An ellipsoid by its centre and half axes, m."""
    return Primitive(
        Kind.ELLIPSOID,
        np.array(center, float),
        np.array(half, float),
        rotation_z(angle_deg),
        materials,
    )
