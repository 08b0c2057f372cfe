"""The axis-aligned box of space that the map covers."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError

_FARTHEST = 1e9  # lengths of a ray: much farther, float64 would not tell a step from none


@dataclass(frozen=True)
class Bound:
    """Axis-aligned box in world coordinates, metres."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.low).all() and np.isfinite(self.high).all()):
            raise UserError(f"bound {self.low} to {self.high}: expected finite metres")
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise UserError(f"bound {self.low} to {self.high}: expected low < high on every axis")

    @classmethod
    def of(cls, low: np.ndarray, high: np.ndarray) -> "Bound":
        """The box between two corners, [3] m each."""
        (x, y, z), (u, v, w) = map(float, low), map(float, high)
        return cls((x, y, z), (u, v, w))

    @property
    def extent_m(self) -> np.ndarray:
        """Side lengths, [3] m."""
        return np.subtract(self.high, self.low)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """Mask [N] of the points [N, 3] (m, world) inside the box."""
        return np.asarray(((points >= self.low) & (points <= self.high)).all(axis=-1))

    def reach(self, origins: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where rays [..., 3] from `origins` [..., 3] m enter and leave the box, [...] in lengths of a ray.

        A ray that misses it, or comes from more than 10^9 lengths away, leaves before it enters.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            low = (np.asarray(self.low) - origins) / rays
            high = (np.asarray(self.high) - origins) / rays
        first = np.fmin(low, high).max(axis=-1)
        last = np.fmax(low, high).min(axis=-1)
        return first, np.where(first < _FARTHEST, last, -np.inf)

    def snapped(self, cell_m: float) -> "Bound":
        """The smallest box around this one, about the same centre, whose sides are whole cells."""
        cells = np.ceil(self.extent_m / cell_m - 1e-6)
        centre = np.add(self.high, self.low) / 2
        low, high = centre - cells * cell_m / 2, centre + cells * cell_m / 2
        return Bound.of(low, high)
