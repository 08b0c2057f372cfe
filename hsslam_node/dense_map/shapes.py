"""Spheres and boxes for queries of free space: a robot, or parts of one, at many places."""

import reprlib
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import FARTHEST_M, are_rigid

_MOST_M = 1e6  # of a body; far larger than a map, far below overflow
_WITHIN = 0.98  # of a half side, for points within a body
_PROBES_A_SIDE = 3


class Shapes(Protocol):
    """N bodies."""

    def __len__(self) -> int: ...

    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres [N, 3] m, world, and half sides [N] m of cubes along the world's axes around them."""
        ...

    def probes(self, of: np.ndarray) -> np.ndarray:
        """A few points within each of the bodies `of` [M], up to its ends, [M, P, 3] m, world."""
        ...

    def distance_m(self, points: np.ndarray, of: np.ndarray) -> np.ndarray:
        """Signed distances [M] m of points [M, 3] to the surface of bodies `of` [M]; negative within."""
        ...


@dataclass(frozen=True)
class Spheres:
    """Spheres about `centres` [N, 3] m, world; `radius_m` [N] or one for all.

    Raises:
        UserError: wrong shape of an array, or a radius not above 0 and at most 1000 km.
    """

    centres: np.ndarray
    radius_m: np.ndarray | float

    def __post_init__(self) -> None:
        object.__setattr__(self, "centres", finite_rows("centres", self.centres, 3))
        expected = f"expected metres above 0, at most {_MOST_M:g}, one or [N]"
        radius_m = _numbers("radius_m", self.radius_m, expected)
        if radius_m.shape not in ((), (len(self),)) or not _are_sizes(radius_m):
            raise UserError(f"radius_m {_short(radius_m)}: {expected}")
        object.__setattr__(self, "radius_m", np.broadcast_to(radius_m, (len(self),)))

    def __len__(self) -> int:
        return len(self.centres)

    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Shapes`."""
        return self.centres, np.asarray(self.radius_m)

    def probes(self, of: np.ndarray) -> np.ndarray:
        """See `Shapes`."""
        ends = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])  # [7, 3]
        reach = _WITHIN * np.asarray(self.radius_m)[of, None, None]
        return self.centres[of, None] + reach * ends

    def distance_m(self, points: np.ndarray, of: np.ndarray) -> np.ndarray:
        """See `Shapes`."""
        return np.linalg.norm(points - self.centres[of], axis=1) - np.asarray(self.radius_m)[of]


@dataclass(frozen=True)
class Boxes:
    """Boxes about the origins of their frames: `T_world_box` [N, 4, 4]; `size_m` [N, 3] or one [3] for all.

    Raises:
        UserError: wrong shape of an array, or a side not above 0 and at most 1000 km.
    """

    T_world_box: np.ndarray
    size_m: np.ndarray

    def __post_init__(self) -> None:
        expected = (
            "expected finite transforms [N, 4, 4], of a rotation and a translation of at most "
            f"{FARTHEST_M:g} m"
        )
        T = _numbers("T_world_box", self.T_world_box, expected)
        if T.ndim != 3 or T.shape[1:] != (4, 4) or not are_rigid(T):
            raise UserError(f"T_world_box {_short(T)}: {expected}")
        expected = f"expected metres above 0, at most {_MOST_M:g}, [3] or [N, 3]"
        size_m = _numbers("size_m", self.size_m, expected)
        if size_m.shape not in ((3,), (len(T), 3)) or not _are_sizes(size_m):
            raise UserError(f"size_m {_short(size_m)}: {expected}")
        object.__setattr__(self, "T_world_box", T)
        object.__setattr__(self, "size_m", np.broadcast_to(size_m, (len(T), 3)))

    @classmethod
    def between(cls, low: np.ndarray, high: np.ndarray) -> "Boxes":
        """Boxes along the world's axes, from corners `low` [N, 3] m to corners `high` [N, 3] m.

        Raises:
            UserError: wrong or different shapes, or a corner `high` that is not above its `low`.
        """
        low, high = finite_rows("low", low, 3), finite_rows("high", high, 3)
        if len(low) != len(high):
            raise UserError(f"high [{len(high)}, 3]: expected [{len(low)}, 3] as low")
        T = np.tile(np.eye(4), (len(low), 1, 1))
        T[:, :3, 3] = (low + high) / 2
        return cls(T, high - low)

    def __len__(self) -> int:
        return len(self.T_world_box)

    def around(self) -> tuple[np.ndarray, np.ndarray]:
        """See `Shapes`."""
        reach = np.abs(self.T_world_box[:, :3, :3]) @ (self.size_m[:, :, None] / 2)  # [N, 3, 1]
        return self.T_world_box[:, :3, 3], reach.max(axis=(1, 2))

    def probes(self, of: np.ndarray) -> np.ndarray:
        """See `Shapes`."""
        steps = np.linspace(-_WITHIN, _WITHIN, _PROBES_A_SIDE)
        lattice = np.stack(np.meshgrid(steps, steps, steps), -1).reshape(-1, 3)  # [27, 3]
        inside = lattice * self.size_m[of, None] / 2  # [M, 27, 3]
        R, t = self.T_world_box[of, :3, :3], self.T_world_box[of, None, :3, 3]
        return np.einsum("nij,npj->npi", R, inside) + t

    def distance_m(self, points: np.ndarray, of: np.ndarray) -> np.ndarray:
        """See `Shapes`."""
        T = self.T_world_box[of]
        local = np.einsum("mji,mj->mi", T[:, :3, :3], points - T[:, :3, 3])
        beyond = np.abs(local) - self.size_m[of] / 2  # [M, 3] by side
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=1)
        return outside + np.minimum(beyond.max(axis=1), 0)


def finite_rows(name: str, values: ArrayLike, width: int) -> np.ndarray:
    """Rows [N, width] of finite float64; UserError with `name` if they are not."""
    expected = f"expected finite numbers [N, {width}]"
    rows = _numbers(name, values, expected)
    if rows.shape == (0,):  # a list of no rows
        return rows.reshape(0, width)
    if rows.ndim != 2 or rows.shape[1] != width or not np.isfinite(rows).all():
        raise UserError(f"{name} {_short(rows)}: {expected}")
    return rows


def rigid_transform(name: str, values: ArrayLike) -> np.ndarray:
    """A transform [4, 4] of float64, neither scaled nor mirrored; UserError with `name` if it is none."""
    expected = (
        f"expected a transform [4, 4] of a rotation and a translation of at most {FARTHEST_M:g} m"
    )
    T = _numbers(name, values, expected)
    if T.shape != (4, 4) or not are_rigid(T[None]):
        given = T.tolist() if T.shape == (4, 4) else _short(T)
        raise UserError(f"{name} {given}: {expected}")
    return T


def _numbers(name: str, values: ArrayLike, expected: str) -> np.ndarray:
    """An array of float64; UserError if numpy makes none, as of words, ragged lists, some tensors, and if
    values are masked."""
    if np.ma.is_masked(values):
        raise UserError(f"{name}: has masked values: {expected}")
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError):
        text = " ".join(reprlib.repr(values).split())
        raise UserError(f"{name} {text}: {expected}") from None


def _are_sizes(lengths_m: np.ndarray) -> bool:
    return bool(((lengths_m > 0) & (lengths_m <= _MOST_M)).all())


def _short(array: np.ndarray) -> str:
    """The array if it is small, else its shape."""
    return str(array.tolist()) if array.size <= 4 else str(list(array.shape))
