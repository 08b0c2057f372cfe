"""Furniture that is carried off: from one frame on it is gone; apart from its scene, which places it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from hsslam_node.synth.parts.primitive import Primitive

_GONE_M = np.array([0.0, 0.0, -10.0])  # below the floor, out of sight


@dataclass(frozen=True)
class CarriedOff:
    """Its `parts` stand in place before frame `gone_from`, and are out of sight from then on."""

    parts: Sequence[Primitive]
    gone_from: int

    def at(self, frame: int) -> list[Primitive]:
        """Its parts at a frame: the same primitives, in their place or out of sight."""
        shift = _GONE_M if frame >= self.gone_from else np.zeros(3)
        return [replace(p, center_m=p.center_m + shift) for p in self.parts]

    @property
    def box_m(self) -> np.ndarray:
        """Low and high corner [2, 3] m of its boxes while it stands."""
        signs = np.array(list(product((-1, 1), repeat=3)))
        corners = np.concatenate(
            [(signs * p.half_m) @ p.rotation.T + p.center_m for p in self.parts]
        )
        return np.stack([corners.min(axis=0), corners.max(axis=0)])
