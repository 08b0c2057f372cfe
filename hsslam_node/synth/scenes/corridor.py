"""The scene of `synth:corridor`: 15 m between bare walls, from one small lobby to another."""

import numpy as np

from hsslam_node.synth.parts.furniture import bookshelf, cabinet, framed, plant, table_lamp
from hsslam_node.synth.parts.home_furniture import closed_door
from hsslam_node.synth.parts.placement import Placement, box, cylinder
from hsslam_node.synth.parts.primitive import HIDDEN, Kind, Primitive
from hsslam_node.synth.parts.walls import Plan, Side, against, room_hull
from hsslam_node.synth.scenes.scene import Scene, Zone
from hsslam_node.synth.scenes.walk import walk_poses

_HEIGHT_M = 2.5
_ENDS_M = (4.2, 19.2)
_DOORS_M = [(_ENDS_M[0], 2.0), (_ENDS_M[1], 2.0)]
_LENGTH = 720
_WAY_M = np.array(
    [
        *((1.2, 2.9), (2.0, 2.15), (4.2, 2.0), (8.0, 2.1), (12.0, 1.9), (16.0, 2.1), (19.2, 2.0)),
        *((21.0, 2.0), (22.2, 1.2), (22.0, 2.7), (20.6, 2.3), (19.2, 2.0)),  # round and back
        *((16.0, 1.9), (12.0, 2.1), (8.0, 1.9), (4.2, 2.0), (2.2, 1.4), (1.2, 1.6)),
    ]
)


def build_corridor(seed: int) -> Scene:
    """Plain paint and linoleum; doors, switches and lamps several metres apart."""
    rng = np.random.default_rng((seed, 1))
    bare = _four("paint:cream")
    first = Plan((0.0, 0.0), (_ENDS_M[0], 4.0), _HEIGHT_M, _four("paint:sky"), "lino:grey")
    middle = Plan((_ENDS_M[0], 1.1), (_ENDS_M[1], 2.9), _HEIGHT_M, bare, "lino:grey", "paint:white")
    last = Plan((_ENDS_M[1], 0.0), (23.4, 4.0), _HEIGHT_M, _four("paint:sage"), "lino:grey")
    furniture = (_lobby(first, Side.WEST, rng), _fittings(middle), _lobby(last, Side.EAST, rng))
    zones = []
    for plan, pieces in zip((first, middle, last), furniture, strict=True):
        lamps = _lamps(plan)
        shades = [
            box((x, y, _HEIGHT_M - 0.03), (0.9, 0.3, 0.06), *_SHADE_FACES) for x, y, _ in lamps
        ]
        zones.append(Zone(room_hull(plan, _DOORS_M) + shades + pieces, lamps))
    size = np.array([23.4, 4.0, _HEIGHT_M])
    shell = Primitive(Kind.ROOM, size / 2, size / 2 + 0.3, np.eye(3), (HIDDEN,))
    return Scene(shell, zones, coarseness=1.5)


def corridor_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4] from lobby to lobby; longer walks turn there and come back."""
    return walk_poses(_WAY_M, length or _LENGTH, seed)


_SHADE_FACES = ("wood:white",) * 4 + (HIDDEN, "glow")


def _four(covering: str) -> tuple[str, str, str, str]:
    """The same on all walls."""
    return (covering, covering, covering, covering)


def _lamps(plan: Plan) -> list[tuple[float, float, float]]:
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    count = max(1, round((x1 - x0) / 3.75))
    step = (x1 - x0) / count
    return [(x0 + (k + 0.5) * step, (y0 + y1) / 2, _HEIGHT_M - 0.09) for k in range(count)]


def _fittings(plan: Plan) -> list[Primitive]:
    """Doors on either side, with a switch and a number each."""
    parts = []
    for side, along in (
        (Side.SOUTH, 2.2), (Side.NORTH, 5.4), (Side.SOUTH, 9.1), (Side.NORTH, 12.4)
    ):  # fmt: skip
        parts += against(plan, side, along).place(closed_door())
        parts += against(plan, side, along + 0.68, 1.08).place(
            [box((0, 0.006, 0), (0.08, 0.012, 0.08), "wood:white")]
        )
        parts += against(plan, side, along - 0.70, 1.55).place(framed(0.16, 0.12, "screen", 0.015))
    parts += against(plan, Side.NORTH, 8.2).place(
        [cylinder((0, 0.09, 0.75), 0.07, 0.45, "metal:red")]
    )
    parts += against(plan, Side.NORTH, 8.2, 1.45).place(framed(0.15, 0.15, "poster", 0.01))
    parts += against(plan, Side.SOUTH, 6.4, 1.5).place(framed(0.6, 0.42, "poster", 0.02))
    return parts


def _lobby(plan: Plan, end: Side, rng: np.random.Generator) -> list[Primitive]:
    """A few pieces round a free middle."""
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    corner = x0 + 0.5 if end == Side.WEST else x1 - 0.5
    return [
        *against(plan, end, 2.0, 1.6).place(framed(1.5, 1.1, "window", 0.02)),
        *against(plan, Side.NORTH, 1.9).place(bookshelf(1.2, 1.3, "wood:pine", rng)),
        *against(plan, Side.SOUTH, 2.1).place(cabinet(1.4, 0.7, 0.36, "wood:oak")),
        *against(plan, Side.SOUTH, 1.8, 0.7).place(table_lamp("mustard")),
        *against(plan, Side.SOUTH, 2.4, 1.6).place(framed(0.8, 0.6, "painting")),
        *against(plan, Side.NORTH, 3.2, 1.6).place(framed(0.5, 0.7, "poster")),
        *Placement(corner, y1 - 0.5).place(plant(1.3, rng)),
        *Placement(corner, y0 + 0.5).place([box((0, 0, 0.2), (0.4, 0.4, 0.4), "cardboard")]),
    ]
