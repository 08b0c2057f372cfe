"""The scene of `synth:lookalike`: thirty rooms with the same furniture; only pictures differ."""

import numpy as np

from hsslam_node.synth.parts.furniture import armchair, cabinet, dresser, framed, table_lamp
from hsslam_node.synth.parts.placement import Placement
from hsslam_node.synth.parts.primitive import HIDDEN, Kind, Primitive
from hsslam_node.synth.parts.walls import Plan, Side, against, room_hull
from hsslam_node.synth.scenes.scene import Scene, Zone
from hsslam_node.synth.scenes.walk import walk_poses

ROOM_M = (4.0, 3.4)
ROOMS_A_ROW = 15  # two rows
_HEIGHT_M = 2.5
_WALLS = ("plaster:cream", "stripes:sage", "wallpaper:sky", "plaster:cream")
_LENGTH_M, _DEPTH_M = ROOMS_A_ROW * ROOM_M[0], 2 * ROOM_M[1]
_END_DOORS_M = [(ROOM_M[0] / 2, ROOM_M[1]), (_LENGTH_M - ROOM_M[0] / 2, ROOM_M[1])]


def build_lookalike(seed: int) -> Scene:
    """Two rows of rooms, each with a door to the next; the rows are joined at both ends."""
    doors = [*_END_DOORS_M]
    for row in range(2):
        y = (row + 0.5) * ROOM_M[1]
        doors += [(k * ROOM_M[0], y) for k in range(1, ROOMS_A_ROW)]
    zones = []
    for row in range(2):
        for k in range(ROOMS_A_ROW):
            low = (k * ROOM_M[0], row * ROOM_M[1])
            high = ((k + 1) * ROOM_M[0], (row + 1) * ROOM_M[1])
            plan = Plan(low, high, _HEIGHT_M, _WALLS, "parquet:oak")
            lamp = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, _HEIGHT_M - 0.16)
            zones.append(Zone(room_hull(plan, doors) + _furniture(plan), [lamp]))
    size = np.array([_LENGTH_M, _DEPTH_M, _HEIGHT_M])
    shell = Primitive(Kind.ROOM, size / 2, size / 2 + 0.3, np.eye(3), (HIDDEN,))
    return Scene(shell, zones, coarseness=4.0)


def lookalike_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4]; one round through all rooms unless a length is given."""
    return walk_poses(_way_m(), length, seed)


def _way_m() -> np.ndarray:
    """Through the first row, and back through the second, [M, 2]."""
    width, middle = ROOM_M[0], ROOM_M[1] / 2
    there = []
    for k in range(ROOMS_A_ROW):
        x = k * width
        door = [(x, middle)] if k else []
        there += [*door, (x + 1.3, middle + 0.35), (x + 2.7, middle - 0.35)]
    back = [(_LENGTH_M - x, _DEPTH_M - y) for x, y in there]
    return np.array([*there, _END_DOORS_M[1], *back, _END_DOORS_M[0]])


def _furniture(plan: Plan) -> list[Primitive]:
    """The same in every room."""
    south, north, west, east = Side.SOUTH, Side.NORTH, Side.WEST, Side.EAST
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    return [
        *against(plan, south, 0.9).place(cabinet(1.1, 0.8, 0.36, "wood:walnut")),
        *against(plan, south, 0.9, 0.8).place(table_lamp("mustard")),
        *against(plan, south, 3.0, 1.6).place(framed(0.8, 0.6, "painting")),
        *against(plan, north, 3.1).place(dresser(1.0, "wood:oak")),
        *against(plan, north, 0.9, 1.6).place(framed(0.6, 0.8, "poster")),
        *against(plan, west, 0.55, 1.6).place(framed(0.5, 0.5, "painting")),
        *against(plan, east, 2.85, 1.6).place(framed(0.5, 0.6, "poster")),
        *Placement(x1 - 0.6, y0 + 0.6, 45).place(armchair("fabric:teal", "fabric:cream")),
        *Placement(x0 + 0.4, y1 - 0.4).place(table_lamp("rose")),
    ]
