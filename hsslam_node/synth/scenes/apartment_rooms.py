"""What stands in the rooms of the apartment; the camera's way stays free."""

import numpy as np

from hsslam_node.synth.parts.furniture import (
    armchair,
    bookshelf,
    cabinet,
    chair,
    coffee_table,
    desk,
    dresser,
    floor_lamp,
    framed,
    plant,
    sofa,
    table,
    table_lamp,
)
from hsslam_node.synth.parts.home_furniture import (
    bed,
    closed_door,
    coat_rack,
    dining_set,
    fridge,
    kitchen_row,
    piano,
    toys,
    wardrobe,
)
from hsslam_node.synth.parts.placement import Placement, ball, box, cylinder
from hsslam_node.synth.parts.primitive import Primitive
from hsslam_node.synth.parts.walls import Plan, Side, against

_EYE_M = 1.6  # where pictures hang
_W, _E, _S, _N = Side.WEST, Side.EAST, Side.SOUTH, Side.NORTH


def living_room(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """Sofa and coffee table on a rug in the middle, television, bookshelf."""
    return [
        *_rug(4.0, 2.9, 2.9, 2.0, "red"),
        *Placement(5.0, 2.9, 90).place(sofa(1.7, "fabric:navy", ("fabric:mustard", "fabric:rose"))),
        *Placement(3.5, 2.9, 87).place(coffee_table("wood:walnut")),
        *_window(plan, _S, 2.3, "teal"),
        *_window(plan, _S, 5.5, "teal"),
        *against(plan, _S, 3.9).place(dresser(1.0, "wood:oak")),
        *_hung(plan, _S, 3.9, 0.5, 0.5, "painting"),
        *Placement(0.75, 0.75, -45).place(armchair("fabric:terracotta", "fabric:cream")),
        *Placement(7.3, 0.5).place(plant(1.4, rng)),
        *against(plan, _W, 2.9).place(bookshelf(1.8, 2.1, "wood:oak", rng)),
        *_hung(plan, _W, 4.7, 0.9, 0.7, "painting"),
        *against(plan, _N, 2.6).place(cabinet(1.7, 0.52, 0.42, "wood:walnut")),
        *against(plan, _N, 2.6, 0.98).place(framed(1.15, 0.68, "screen", 0.05)),
        *against(plan, _N, 1.2).place(floor_lamp("cream")),
        *against(plan, _N, 4.5).place(cabinet(1.0, 0.85, 0.36, "wood:oak")),
        *against(plan, _N, 4.5, 0.85).place(_vases("mustard", "sky")),
        *_hung(plan, _N, 4.5, 0.8, 0.55, "painting"),
        *Placement(0.5, 5.3).place(plant(1.1, rng)),
        *against(plan, _E, 3.6).place(table(0.9, 0.36, 0.78, "wood:walnut")[:2]),
        *against(plan, _E, 3.6, 0.78).place(table_lamp("rose")),
        *_hung(plan, _E, 4.5, 0.6, 0.8, "poster"),
        *_hung(plan, _E, 0.6, 0.5, 0.7, "painting"),
    ]


def kitchen(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """A row of counters, a fridge, a small table that the camera goes round."""
    return [
        *against(plan, _N, 2.9).place(kitchen_row(3.0, "cream", rng)),
        *against(plan, _N, 0.75).place(fridge("sky")),
        *_hung(plan, _N, 4.6, 0.4, 0.6, "poster"),
        *Placement(10.5, 2.8, 6).place(dining_set(1.1, "wood:pine", "fabric:red", 1)),
        *_window(plan, _S, 2.6, "mustard"),
        *against(plan, _S, 2.6).place(cabinet(1.7, 0.86, 0.42, "wood:pine")),
        *against(plan, _S, 2.3, 0.86).place(_vases("teal", "terracotta")),
        *Placement(8.4, 0.5).place(plant(1.2, rng)),
        *_hung(plan, _S, 4.3, 0.5, 0.7, "poster"),
        *_hung(plan, _W, 3.1, 0.7, 0.5, "painting"),
        *against(plan, _W, 4.3).place(bookshelf(0.8, 1.2, "wood:pine", rng)),
        *_hung(plan, _E, 3.2, 0.8, 0.6, "painting"),
        *against(plan, _E, 4.4).place(bookshelf(0.9, 0.85, "wood:pine", rng)),
        *against(plan, _E, 4.4, 0.86).place(_vases("red", "sky")),
    ]


def study(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """Bookshelves, a desk, a reading corner, a globe on a rug."""
    return [
        *_rug(15.3, 2.7, 2.0, 1.5, "teal"),
        *Placement(15.25, 2.75, 12).place(table(0.7, 0.7, 0.52, "wood:walnut")),
        *Placement(15.25, 2.75, 0, 0.52).place([ball((0, 0, 0.17), (0.17,) * 3, "stone:sky")]),
        *_window(plan, _S, 2.7, "rose"),
        *against(plan, _S, 4.6).place(dresser(1.0, "wood:walnut")),
        *_hung(plan, _S, 4.6, 0.6, 0.5, "painting"),
        *_hung(plan, _S, 0.8, 0.6, 0.8, "poster"),
        *against(plan, _E, 2.5).place(bookshelf(2.0, 2.1, "wood:walnut", rng)),
        *against(plan, _E, 4.3).place(bookshelf(1.2, 1.5, "wood:oak", rng)),
        *_hung(plan, _E, 0.8, 0.6, 0.6, "painting"),
        *against(plan, _W, 4.2).place(desk(1.6, "wood:oak")),
        *Placement(14.2, 4.15, 84).place(chair("wood:walnut", "fabric:teal")),
        *_hung(plan, _W, 4.2, 0.9, 0.4, "painting", 1.85),
        *_hung(plan, _W, 0.7, 0.5, 0.7, "poster"),
        *Placement(13.35, 6.0).place(plant(1.5, rng)),
        *against(plan, _N, 1.5).place(floor_lamp("mustard")),
        *against(plan, _N, 3.9).place(cabinet(1.2, 0.80, 0.40, "wood:walnut")),
        *against(plan, _N, 3.9, 0.80).place(_vases("teal", "rose")),
        *_hung(plan, _N, 3.9, 0.9, 0.6, "painting"),
        *Placement(17.75, 5.85, 135).place(armchair("fabric:teal", "fabric:mustard")),
    ]


def bedroom(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """A double bed, a wardrobe, a dresser."""
    nights = []
    for along in (2.65, 4.95):
        nights += against(plan, _E, along).place(table(0.42, 0.40, 0.5, "wood:pine"))
        nights += Placement(18.1, 6.5 + along, 0, 0.5).place(table_lamp("sky"))
    return [
        *_rug(15.7, 10.3, 1.6, 2.4, "rose"),
        *against(plan, _E, 3.8).place(bed(1.6, "wood:pine", "fabric:sky", "fabric:rose")),
        *nights,
        *_hung(plan, _E, 3.8, 1.2, 0.6, "painting", 1.65),
        *_window(plan, _E, 1.2, "rose"),
        *against(plan, _N, 2.7).place(wardrobe(2.0, 2.1, "wood:oak")),
        *_hung(plan, _N, 0.8, 0.6, 0.8, "poster"),
        *Placement(17.8, 12.8).place(plant(1.2, rng)),
        *against(plan, _W, 1.9).place(dresser(1.1, "wood:pine")),
        *_hung(plan, _W, 1.9, 0.6, 0.7, "painting", 1.7),
        *_hung(plan, _W, 3.6, 0.8, 0.6, "painting"),
        *Placement(13.55, 7.25, -45).place(armchair("fabric:rose", "fabric:cream")),
        *against(plan, _S, 4.5).place(bookshelf(1.0, 1.1, "wood:oak", rng)),
        *_hung(plan, _S, 4.5, 0.6, 0.6, "poster", 1.7),
        *_hung(plan, _S, 1.0, 0.5, 0.5, "poster"),
    ]


def children(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """A bed in the corner, a desk under the window, toys on the rug."""
    return [
        *_rug(9.55, 10.6, 2.2, 2.0, "sky"),
        *Placement(9.55, 10.6).place(toys(rng)),
        *Placement(12.15, 7.62).place(bed(0.95, "wood:white", "fabric:mustard", "fabric:teal")),
        *_hung(plan, _E, 1.2, 0.9, 0.6, "poster"),
        *_hung(plan, _E, 2.6, 0.5, 0.7, "painting"),
        *against(plan, _N, 2.8).place(desk(1.4, "wood:pine")),
        *Placement(9.75, 12.3, 172).place(chair("wood:pine", "fabric:red")),
        *_window(plan, _N, 2.8, "sky"),
        *against(plan, _N, 4.7).place(bookshelf(1.1, 1.5, "wood:white", rng)),
        *against(plan, _N, 0.95).place(wardrobe(1.2, 1.9, "wood:sky")),
        *against(plan, _S, 2.1).place(cabinet(1.4, 0.60, 0.40, "wood:pine")),
        *against(plan, _S, 2.1, 0.60).place(_vases("red", "green")),
        *_hung(plan, _S, 2.1, 1.0, 0.6, "poster"),
        *_hung(plan, _S, 3.6, 0.6, 0.8, "painting"),
        *against(plan, _W, 1.3).place(bookshelf(0.9, 1.1, "wood:white", rng)),
        *_hung(plan, _W, 2.4, 0.7, 0.7, "poster"),
    ]


def dining_room(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """A long table with six chairs, a piano, a sideboard between windows."""
    return [
        *_rug(4.2, 9.75, 3.0, 2.4, "navy"),
        *Placement(4.2, 9.75, 2).place(dining_set(2.0, "wood:oak", "fabric:teal", 3)),
        *_window(plan, _N, 1.6, "terracotta"),
        *_window(plan, _N, 5.4, "terracotta"),
        *against(plan, _N, 3.5).place(cabinet(1.6, 0.88, 0.42, "wood:oak")),
        *against(plan, _N, 3.5, 0.88).place(_vases("navy", "mustard")),
        *_hung(plan, _N, 3.5, 1.0, 0.6, "painting", 1.7),
        *against(plan, _W, 3.3).place(bookshelf(1.7, 2.0, "wood:walnut", rng)),
        *_hung(plan, _W, 1.2, 0.9, 0.7, "painting"),
        *Placement(0.55, 12.85).place(plant(1.5, rng)),
        *against(plan, _S, 4.4).place(piano("wood:walnut")),
        *_hung(plan, _S, 3.0, 0.6, 0.8, "painting"),
        *_hung(plan, _S, 5.8, 0.6, 0.6, "poster"),
        *against(plan, _E, 1.5).place(dresser(1.1, "wood:oak")),
        *_hung(plan, _E, 1.5, 0.8, 0.6, "painting", 1.7),
        *against(plan, _E, 5.2).place(floor_lamp("terracotta")),
    ]


def hall(plan: Plan, rng: np.random.Generator) -> list[Primitive]:
    """Coats, pictures, closed doors, a runner."""
    return [
        *_rug(4.0, 6.65, 4.6, 0.8, "terracotta"),
        *_rug(10.0, 6.65, 4.0, 0.8, "navy"),
        *against(plan, _W, 0.85).place(closed_door()),
        *against(plan, _S, 3.6).place(coat_rack(1.4, rng)),
        *_hung(plan, _S, 1.0, 0.6, 0.8, "painting"),
        *against(plan, _S, 2.0).place(cabinet(0.8, 0.80, 0.28, "wood:walnut")),
        *against(plan, _S, 2.0, 0.80).place(_vases("teal", "cream")),
        *_hung(plan, _S, 5.3, 0.6, 0.8, "poster"),
        *_hung(plan, _S, 8.0, 0.9, 0.6, "painting"),
        *_hung(plan, _N, 3.4, 0.9, 0.6, "painting"),
        *_hung(plan, _N, 4.7, 0.6, 0.8, "poster"),
        *_hung(plan, _N, 0.6, 0.4, 0.6, "poster"),
        *against(plan, _N, 6.6).place(closed_door()),
        *against(plan, _N, 8.4).place(bookshelf(1.0, 1.1, "wood:oak", rng)),
        *against(plan, _N, 11.0).place(closed_door()),
        *against(plan, _S, 10.4).place(closed_door()),
        *against(plan, _E, 0.85).place(dresser(0.9, "wood:oak")),
        *_hung(plan, _E, 0.85, 0.6, 0.8, "painting", 1.75),
    ]


def _rug(x: float, y: float, wide: float, deep: float, color: str) -> list[Primitive]:
    return [box((x, y, 0.006), (wide, deep, 0.012), f"carpet:{color}")]


def _hung(
    plan: Plan, side: Side, along: float, wide: float, tall: float, picture: str, z: float = _EYE_M
) -> list[Primitive]:
    return against(plan, side, along, z).place(framed(wide, tall, picture))


def _window(plan: Plan, side: Side, along: float, curtain: str) -> list[Primitive]:
    """A window with a sill and curtains on a rail."""
    parts = [
        *framed(1.5, 1.2, "window", 0.02),
        box((0, 0.06, -0.63), (1.66, 0.12, 0.04), "wood:white"),
        box((0, 0.07, 0.72), (2.2, 0.03, 0.03), "metal:brass"),
    ]
    for wing in (-1, 1):
        for k in range(4):
            x = wing * (0.80 + 0.075 * k)
            parts.append(cylinder((x, 0.06, 0), 0.045, 1.45, f"fabric:{curtain}"))
    return against(plan, side, along, 1.65).place(parts)


def _vases(one: str, other: str) -> list[Primitive]:
    """Two vases and a pile of books, on something about a metre wide."""
    return [
        ball((-0.28, 0.17, 0.14), (0.085, 0.085, 0.14), f"glazed:{one}"),
        cylinder((-0.28, 0.17, 0.29), 0.035, 0.09, f"glazed:{one}"),
        cylinder((-0.10, 0.20, 0.09), 0.06, 0.18, f"glazed:{other}"),
        box((0.22, 0.18, 0.025), (0.26, 0.20, 0.05), "book:navy", angle_deg=9),
        box((0.23, 0.18, 0.07), (0.23, 0.17, 0.04), "book:mustard", angle_deg=-12),
    ]
