"""A scene: primitives, grouped by the room that they stand in."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from hsslam_node.synth.parts.primitive import Primitive


@dataclass(frozen=True)
class Zone:
    """The things of one room and its lamps, lit together. Light does not leave a zone."""

    parts: list[Primitive]
    lamps_m: list[tuple[float, float, float]]
    """Centres of the lamps, 0.9 m squares that hang level."""


class Moving(Protocol):
    """Parts of a scene that move."""

    def at(self, frame: int) -> list[Primitive]:
        """Its parts at a frame: always the same primitives, turned and moved."""
        ...


@dataclass(frozen=True)
class Scene:
    """All parts; floor at z = 0, m."""

    shell: Primitive
    """Encloses all else, so that every ray ends; lit as part of the first zone."""
    zones: list[Zone]
    coarseness: float = 1.0
    """Scales the texels: large scenes have coarser ones, or the atlas would take a gigabyte."""

    moving: Moving | None = None
    """What moves, lit as part of the first zone; casts no shadow."""

    @cached_property
    def still_parts(self) -> list[Primitive]:
        """All primitives that do not move, the shell first."""
        return [self.shell, *(part for zone in self.zones for part in zone.parts)]

    def parts_at(self, frame: int) -> list[Primitive]:
        """All primitives as they are at a frame, those that move last."""
        return self.still_parts + (self.moving.at(frame) if self.moving else [])


def scene_arrays(parts: list[Primitive]) -> dict[str, np.ndarray]:
    """Kinds [P], rotations [P, 3, 3], centers [P, 3] and halves [P, 3] (m), as the kernels take them."""
    return {
        "kinds": np.array([int(p.kind) for p in parts], np.int32),
        "rotations": np.stack([p.rotation for p in parts]).astype(np.float64),
        "centers": np.stack([p.center_m for p in parts]).astype(np.float64),
        "halves": np.stack([p.half_m for p in parts]).astype(np.float64),
    }
