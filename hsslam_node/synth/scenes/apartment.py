"""The scene of `synth:apartment`: seven rooms round a loop of more than 60 m, and the way through them."""

from collections.abc import Callable

import numpy as np

from hsslam_node.synth.parts.primitive import HIDDEN, Kind, Primitive
from hsslam_node.synth.parts.walls import Plan, room_hull
from hsslam_node.synth.scenes.apartment_rooms import (
    bedroom,
    children,
    dining_room,
    hall,
    kitchen,
    living_room,
    study,
)
from hsslam_node.synth.scenes.scene import Scene, Zone
from hsslam_node.synth.scenes.walk import walk_poses

_HEIGHT_M = 2.6
_SIZE_M = (18.4, 13.4)
DOORS_M = [
    (7.8, 1.7), (12.8, 1.8), (15.4, 6.5), (12.8, 11.8), (7.0, 11.0), (1.6, 7.5), (6.6, 5.8)
]  # fmt: skip
"""Where the camera goes from room to room: the middles of the openings, [x, y]."""
_LIVING = ("wallpaper:sage", "plaster:cream", "brick:terracotta", "wallpaper:cream")
_KITCHEN = ("plaster:sky", "tiles:cream", "plaster:mustard", "wallpaper:sky")
_STUDY = ("stripes:sage", "plaster:cream", "stripes:rose", "wallpaper:sage")
_BEDROOM = ("wallpaper:rose", "stripes:sky", "plaster:rose", "wallpaper:cream")
_CHILDREN = ("stripes:mustard", "wallpaper:sky", "plaster:sky", "stripes:teal")
_DINING = ("brick:white", "wallpaper:cream", "stripes:terracotta", "plaster:sage")
_HALL = ("plaster:cream", "stripes:cream", "wallpaper:sage", "plaster:terracotta")


def build_apartment(seed: int) -> Scene:
    """All rooms; x to 18.4, y to 13.4, ceiling at 2.6 m. The seed chooses colours and small things."""
    rng = np.random.default_rng((seed, 1))
    rooms: list[tuple[Plan, Callable]] = [
        (_plan((0.0, 0.0), (7.8, 5.8), _LIVING, "parquet:oak"), living_room),
        (_plan((7.8, 0.0), (12.8, 5.8), _KITCHEN, "tiles:terracotta"), kitchen),
        (_plan((12.8, 0.0), (18.4, 6.5), _STUDY, "planks:walnut"), study),
        (_plan((12.8, 6.5), (18.4, 13.4), _BEDROOM, "planks:pine"), bedroom),
        (_plan((7.0, 7.5), (12.8, 13.4), _CHILDREN, "parquet:pine"), children),
        (_plan((0.0, 7.5), (7.0, 13.4), _DINING, "planks:oak"), dining_room),
        (_plan((0.0, 5.8), (12.8, 7.5), _HALL, "tiles:grey"), hall),
    ]
    zones = []
    for plan, furnish in rooms:
        zones.append(Zone(room_hull(plan, DOORS_M) + furnish(plan, rng), _lamps(plan)))
    size = np.array([*_SIZE_M, _HEIGHT_M])
    shell = Primitive(Kind.ROOM, size / 2, size / 2 + 0.3, np.eye(3), (HIDDEN,))
    return Scene(shell, zones, coarseness=1.8)


def _plan(low_m, high_m, walls: tuple[str, str, str, str], floor: str) -> Plan:
    return Plan(low_m, high_m, _HEIGHT_M, walls, floor)


def _lamps(plan: Plan) -> list[tuple[float, float, float]]:
    """One lamp for every 14 m2 or so, in a row along the longer side."""
    (x0, y0), (x1, y1) = plan.low_m, plan.high_m
    wide, deep = x1 - x0, y1 - y0
    count = max(2, round(max(wide, deep) / 3.2))
    lamps = []
    for k in range(count):
        along, across = (k + 0.5) / count, 0.44 if k % 2 else 0.56
        u, v = (along, across) if wide >= deep else (across, along)
        lamps.append((x0 + u * wide, y0 + v * deep, plan.height_m - 0.16))
    return lamps


_WAY_M = np.array(
    [
        *((4.9, 4.5), (2.4, 4.3), (1.6, 2.9), (2.3, 1.55), (4.4, 1.45), (6.6, 1.7)),  # living room
        *((7.8, 1.7), (8.9, 2.2), (9.2, 3.9), (10.6, 4.3), (11.8, 3.6), (11.9, 2.1)),  # kitchen
        *((12.8, 1.8), (14.0, 1.7), (16.3, 1.4), (17.1, 2.7), (15.9, 3.9), (14.8, 4.6)),  # study
        *(
            (15.3, 5.6),
            (15.4, 6.5),
            (15.5, 7.1),
            (16.0, 7.8),
            (15.0, 8.5),
            (14.0, 9.9),
            (14.0, 11.5),
        ),  # bedroom
        *((12.8, 11.8), (11.7, 11.8), (11.0, 10.1), (10.4, 8.9), (8.8, 8.7)),  # children's room
        *((8.1, 10.4), (7.0, 11.0), (5.7, 11.4), (3.7, 11.9), (1.8, 11.4), (1.5, 9.6)),  # dining
        *(
            (1.6, 8.4),
            (1.6, 7.5),
            (1.7, 6.8),
            (4.4, 6.65),
            (6.3, 6.65),
            (6.6, 5.8),
            (6.5, 5.0),
        ),  # hall
    ]
)


def apartment_poses(length: int | None, seed: int) -> np.ndarray:
    """Camera-to-world poses [n, 4, 4]; one round through all rooms unless a length is given."""
    return walk_poses(_WAY_M, length, seed)
