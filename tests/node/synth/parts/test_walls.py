"""Walls and doors of a room."""

import numpy as np
import pytest

from hsslam_node.synth.parts.placement import box
from hsslam_node.synth.parts.primitive import Primitive
from hsslam_node.synth.parts.walls import Plan, Side, against, room_hull

_WALLS = ("plaster:sage", "plaster:sky", "plaster:rose", "plaster:cream")
_PLAN = Plan((1.0, 2.0), (5.0, 5.0), 2.6, _WALLS, "planks:oak")


def _is_inside(point: tuple[float, float, float], parts: list[Primitive]) -> bool:
    local = [(np.array(point) - p.center_m) @ p.rotation / p.half_m for p in parts]
    return any(bool((np.abs(x) < 1).all()) for x in local)


def _material_at(point: tuple[float, float, float], parts: list[Primitive]) -> str:
    """Of the largest piece that holds the point, the face that looks to the middle of the room."""
    part = next(p for p in parts if _is_inside(point, [p]))
    middle = np.array([3.0, 3.5, point[2]])
    local = (middle - part.center_m) @ part.rotation
    return part.material(2 if local[1] > 0 else 3)


def test_a_door_opens_the_wall_that_it_is_in_and_no_other():
    doors = [(2.5, 2.0), (5.0, 3.0), (9.0, 9.0)]
    parts = room_hull(_PLAN, doors)
    assert not _is_inside((2.5, 2.03, 1.0), parts)
    assert not _is_inside((4.97, 3.0, 1.0), parts)
    assert _is_inside((2.5, 2.03, 2.3), parts)  # above the door
    assert _is_inside((4.0, 2.03, 1.0), parts)
    assert _is_inside((2.5, 4.97, 1.0), parts)
    assert _is_inside((1.03, 3.0, 1.0), parts)


def test_every_wall_has_its_own_covering():
    parts = room_hull(_PLAN, [])
    points = [(3.0, 2.03, 1.0), (3.0, 4.97, 1.0), (1.03, 3.5, 1.0), (4.97, 3.5, 1.0)]
    assert tuple(_material_at(point, parts) for point in points) == _WALLS


@pytest.mark.parametrize(
    ("side", "low", "high"),
    [
        (Side.SOUTH, (1.5, 2.06), (2.5, 2.5)),
        (Side.NORTH, (1.5, 4.5), (2.5, 4.94)),
        (Side.WEST, (1.06, 2.5), (1.5, 3.5)),
        (Side.EAST, (4.5, 2.5), (4.94, 3.5)),
    ],
)
def test_furniture_stands_with_its_back_to_the_wall(side, low, high):
    (part,) = against(_PLAN, side, 1.0).place([box((0, 0.2, 0.5), (1.0, 0.4, 1.0), "wood:oak")])
    reach = np.abs(part.rotation @ np.diag(part.half_m)).sum(1)
    assert (part.center_m - reach)[:2] == pytest.approx(low, abs=0.05)
    assert (part.center_m + reach)[:2] == pytest.approx(high, abs=0.05)
    assert (part.center_m - reach)[:2] == pytest.approx(
        np.maximum(low, part.center_m[:2] - reach[:2])
    )
