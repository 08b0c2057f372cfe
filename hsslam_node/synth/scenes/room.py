"""The scene of `synth:room`: a living room."""

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
from hsslam_node.synth.parts.placement import Placement, ball, box, cylinder
from hsslam_node.synth.parts.primitive import Kind, Primitive
from hsslam_node.synth.scenes.scene import Scene, Zone


def build_room(size_m: tuple[float, float, float], seed: int) -> Scene:
    """The room of this length, width and height; one corner at the origin, m.

    Furniture is at the walls; the ellipse in the middle is for the camera.
    """
    rng = np.random.default_rng((seed, 1))
    length, width, height = size_m
    accents = rng.permutation(["mustard", "terracotta", "teal", "rose", "sky", "red"])
    shell = _shell(size_m, rng)
    parts = _north(length, width, height, accents)
    parts += _east(length, width, height, rng)
    parts += _south(length, height, accents)
    parts += _west(width, height, accents)
    parts.append(
        box((length / 2, width / 2, 0.006), (0.52 * length, 0.48 * width, 0.012), "carpet:red")
    )
    parts += Placement(length * 0.5, width - 1.42, 4).place(coffee_table("wood:walnut"))
    for k in range(3):  # beams
        y = width * (k + 0.5) / 3
        parts.append(box((length / 2, y, height - 0.06), (length, 0.14, 0.12), "wood:walnut"))
    lamps = [(x * length, y * width, height - 0.16) for x, y in ((0.36, 0.40), (0.66, 0.62))]
    return Scene(shell, [Zone(parts, lamps)])


def _shell(size_m: tuple[float, float, float], rng: np.random.Generator) -> Primitive:
    half = np.array(size_m) / 2
    walls = ("wallpaper:sage", "brick:terracotta", "wallpaper:cream", "wallpaper:sky")
    turned = np.roll(walls, int(rng.integers(4)))
    materials = (*(str(w) for w in turned), "plaster:white", "planks:oak")
    return Primitive(Kind.ROOM, half, half, np.eye(3), materials)


def _north(length: float, width: float, height: float, accents: np.ndarray) -> list[Primitive]:
    """Sofa, pictures, side table with a lamp; fronts look to -y."""
    c = length * 0.48
    hang = min(1.62, height - 0.75)
    seat = Placement(0.30, width - 0.30, 225)
    return [
        *(seat.place(armchair("fabric:terracotta", "fabric:cream")) if length >= 5.2 else []),
        *Placement(c, width - 0.03, 180).place(
            sofa(2.05, "fabric:navy", (f"fabric:{accents[0]}", f"fabric:{accents[1]}"))
        ),
        *Placement(c - 0.55, width, 180, hang).place(framed(0.80, 0.58, "painting")),
        *Placement(c + 0.42, width, 180, hang + 0.04).place(framed(0.46, 0.62, "poster")),
        *Placement(c + 1.38, width - 0.34, 180).place(table(0.46, 0.46, 0.52, "wood:oak")),
        *Placement(c + 1.38, width - 0.34, 180, 0.52).place(table_lamp(str(accents[2]))),
        *Placement(c - 1.36, width - 0.28).place(floor_lamp("cream")),
        *Placement(0.55, width, 180, hang).place(framed(0.5, 0.5, "poster")),
    ]


def _east(length: float, width: float, height: float, rng: np.random.Generator) -> list[Primitive]:
    """Bookshelf, plant, cardboard boxes; fronts look to -x."""
    return [
        *Placement(length, width * 0.52, 90).place(
            bookshelf(1.5, min(2.0, height - 0.35), "wood:oak", rng)
        ),
        *Placement(length - 0.42, width - 0.42).place(plant(1.35, rng)),
        *Placement(length - 0.38, 0.95).place(
            [
                box((0, 0, 0.19), (0.52, 0.42, 0.38), "cardboard", angle_deg=8),
                box((0.03, 0.02, 0.51), (0.40, 0.34, 0.26), "cardboard", angle_deg=-16),
                ball((-0.02, 0.62, 0.13), (0.13, 0.13, 0.13), "glazed:red"),
            ]
        ),
    ]


def _south(length: float, height: float, accents: np.ndarray) -> list[Primitive]:
    """Desk with a chair, the window with its curtains; fronts look to +y."""
    c = length * 0.55
    sill, tall = 1.05, min(1.2, height - 1.3)
    middle = sill + tall / 2
    parts = [
        *Placement(c, 0.02).place(desk(1.55, "wood:pine")),
        *Placement(c - 0.12, 1.12, 188).place(chair("wood:walnut", f"fabric:{accents[3]}")),
        *Placement(c, 0, 0, middle).place(framed(1.5, tall, "window", 0.02)),
        box((c, 0.06, sill - 0.03), (1.66, 0.12, 0.04), "wood:white"),
        box((c, 0.07, sill + tall + 0.08), (2.2, 0.03, 0.03), "metal:brass"),
    ]
    parts += Placement(0.78, 0.02).place(dresser(0.95, "wood:oak"))
    parts += Placement(0.78, 0, 0, min(1.68, height - 0.6)).place(framed(0.62, 0.62, "painting"))
    for side in (-1, 1):
        for k in range(4):
            x = c + side * (0.80 + 0.075 * k)
            parts.append(cylinder((x, 0.06, middle), 0.045, tall + 0.25, f"fabric:{accents[4]}"))
    return parts


def _west(width: float, height: float, accents: np.ndarray) -> list[Primitive]:
    """Door, low cabinet with a screen, vases, a small table with a chair; fronts look to +x."""
    c = width * 0.585
    return [
        *Placement(0, width * 0.24, -90, 1.01).place(
            [
                box((0, 0.02, 0), (0.80, 0.04, 2.02), "panels:white"),
                ball((0.33, 0.08, 0), (0.05, 0.03, 0.02), "metal:brass"),
            ]
        ),
        *Placement(0.02, c, -90).place(cabinet(1.45, 0.55, 0.42, "wood:walnut")),
        *Placement(0.06, c, -90, 0.98).place(framed(1.05, 0.62, "screen", 0.05)),
        *Placement(0.22, c, -90, 0.56).place(
            [box((0, 0, 0.05), (0.5, 0.2, 0.10), "metal:charcoal")]
        ),
        *Placement(0.24, c + 0.60, -90, 0.55).place(
            [
                ball((0, 0, 0.15), (0.09, 0.09, 0.15), f"glazed:{accents[5]}"),
                cylinder((0, 0, 0.31), 0.035, 0.10, f"glazed:{accents[5]}"),
                box((-1.2, 0.02, 0.04), (0.26, 0.2, 0.08), "book:red", angle_deg=20),
                ball((-1.2, 0.02, 0.15), (0.07, 0.07, 0.07), "stone:sage"),
            ]
        ),
        *Placement(0, c, -90, min(1.78, height - 0.45)).place(framed(0.95, 0.40, "painting")),
    ]  # fmt: skip
