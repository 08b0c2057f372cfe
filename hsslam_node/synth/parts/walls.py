"""Walls with doors: the hull of one room of a larger dwelling, as boxes."""

from dataclasses import dataclass
from enum import Enum

from hsslam_node.synth.parts.placement import Placement, box
from hsslam_node.synth.parts.primitive import HIDDEN, Primitive

_LINING_M = 0.06  # half of a wall: the room behind has the other half
_DOOR_M = (0.95, 2.05)
_SKIRTING_M = 0.014
_TRIM = "wood:white"


@dataclass(frozen=True)
class Plan:
    """A room between the middles of its walls (m), and its coverings.

    `walls`: south (-y), north, west (-x), east.
    """

    low_m: tuple[float, float]
    high_m: tuple[float, float]
    height_m: float
    walls: tuple[str, str, str, str]
    floor: str
    ceiling: str = "plaster:white"


class Side(Enum):
    """A wall, by its direction from the middle of the room."""

    SOUTH = "-y"
    NORTH = "+y"
    WEST = "-x"
    EAST = "+x"


def against(plan: Plan, side: Side, along_m: float, z_m: float = 0.0) -> Placement:
    """Back to the wall, `along_m` from the room's low corner; above 1 m right on the wall."""
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    gap = _LINING_M + (0.0 if z_m > 1 else _SKIRTING_M)
    if side in (Side.SOUTH, Side.NORTH):
        y, turn = (y0 + gap, 0) if side == Side.SOUTH else (y1 - gap, 180)
        return Placement(x0 + along_m, y, turn, z_m)
    x, turn = (x0 + gap, -90) if side == Side.WEST else (x1 - gap, 90)
    return Placement(x, y0 + along_m, turn, z_m)


def room_hull(plan: Plan, doors_m: list[tuple[float, float]]) -> list[Primitive]:
    """Floor, ceiling, walls with skirting; openings at those doors that lie in a wall of the room."""
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    center, size = ((x0 + x1) / 2, (y0 + y1) / 2), (x1 - x0, y1 - y0)
    h = HIDDEN
    parts = [
        box((*center, -0.025), (*size, 0.05), h, h, h, h, plan.floor, h),
        box((*center, plan.height_m + 0.025), (*size, 0.05), h, h, h, h, h, plan.ceiling),
    ]
    sides = (
        (Placement(x0, y0, 0), x1 - x0, [x - x0 for x, y in doors_m if y == y0 and x0 < x < x1]),
        (Placement(x1, y1, 180), x1 - x0, [x1 - x for x, y in doors_m if y == y1 and x0 < x < x1]),
        (Placement(x0, y1, -90), y1 - y0, [y1 - y for x, y in doors_m if x == x0 and y0 < y < y1]),
        (Placement(x1, y0, 90), y1 - y0, [y - y0 for x, y in doors_m if x == x1 and y0 < y < y1]),
    )
    for (placement, length, doors), material in zip(sides, plan.walls, strict=True):
        parts += placement.place(_wall(length, plan.height_m, sorted(doors), material))
    return parts


def _wall(length: float, height: float, doors: list[float], material: str) -> list[Primitive]:
    """A wall from 0 to `length` along x, its face at y = `_LINING_M`, looking to +y."""
    wide, tall = _DOOR_M
    ends = [0.0, *(at + side * wide / 2 for at in doors for side in (-1, 1)), length]
    parts = []
    for left, right in zip(ends[::2], ends[1::2], strict=True):
        parts.append(_slab(left, right, 0.0, height, material))
        middle, skirt = (left + right) / 2, right - left
        parts.append(
            box((middle, _LINING_M + _SKIRTING_M / 2, 0.045), (skirt, _SKIRTING_M, 0.09), _TRIM)
        )
    for at in doors:
        parts.append(_slab(at - wide / 2, at + wide / 2, tall, height, material))
        y = _LINING_M + 0.010
        for side in (-1, 1):
            x = at + side * (wide / 2 + 0.04)
            parts.append(box((x, y, tall / 2 + 0.04), (0.08, 0.02, tall + 0.08), _TRIM))
        parts.append(box((at, y, tall + 0.04), (wide, 0.02, 0.08), _TRIM))
    return parts


def _slab(left: float, right: float, low: float, high: float, material: str) -> Primitive:
    under = _TRIM if low else HIDDEN
    return box(
        ((left + right) / 2, _LINING_M / 2, (low + high) / 2),
        (right - left, _LINING_M, high - low),
        _TRIM, _TRIM, material, HIDDEN, HIDDEN, under,
    )  # fmt: skip
