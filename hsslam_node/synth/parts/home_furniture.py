"""Furniture of kitchens and bedrooms, each in its own frame as in `furniture`."""

import numpy as np

from hsslam_node.synth.parts.furniture import chair, table
from hsslam_node.synth.parts.placement import Placement, ball, box, cylinder
from hsslam_node.synth.parts.primitive import Primitive


def bed(width: float, wood: str, cover: str, pillow: str) -> list[Primitive]:
    """A bed of 2 m with its head at -y: frame, mattress, folded blanket, pillows."""
    parts = [
        box((0, 0.03, 0.50), (width + 0.08, 0.06, 1.00), wood),
        box((0, 1.05, 0.20), (width + 0.04, 2.00, 0.22), wood),
        box((0, 1.04, 0.40), (width, 1.96, 0.20), "fabric:cream"),
        box((0, 1.38, 0.47), (width + 0.06, 1.32, 0.12), cover),
        box((0, 0.76, 0.53), (width + 0.05, 0.28, 0.06), pillow),
        box((0, 2.07, 0.32), (width + 0.08, 0.05, 0.50), wood),
    ]
    for side in (-1, 1) if width > 1.2 else (0,):
        parts.append(ball((side * width / 4, 0.36, 0.56), (0.32, 0.22, 0.09), pillow))
    return parts


def wardrobe(width: float, height: float, wood: str) -> list[Primitive]:
    """A wardrobe with panelled doors, a suitcase and a box on top."""
    front = f"panels:{wood.partition(':')[2]}"
    return [
        box((0, 0.30, height / 2), (width, 0.60, height), wood, wood, front, wood, wood, wood),
        box((0, 0.31, height + 0.02), (width + 0.06, 0.66, 0.04), wood),
        box((-width / 4, 0.30, height + 0.13), (0.60, 0.40, 0.18), "fabric:charcoal", angle_deg=6),
        box((width / 4, 0.30, height + 0.15), (0.42, 0.36, 0.22), "cardboard", angle_deg=-9),
        cylinder((0.05, 0.61, height * 0.5), 0.012, 0.16, "metal:brass"),
        cylinder((-0.05, 0.61, height * 0.5), 0.012, 0.16, "metal:brass"),
    ]


def kitchen_row(width: float, front: str, rng: np.random.Generator) -> list[Primitive]:
    """Counters with a stove and a sink, wall cabinets above, and small kitchen things."""
    top, face = 0.92, f"panels:{front}"
    plain = f"wood:{front}"
    parts = [
        box((0, 0.29, 0.05), (width - 0.06, 0.50, 0.10), "metal:charcoal"),
        box((0, 0.30, 0.49), (width, 0.58, 0.78), plain, plain, face, plain, plain, plain),
        box((0, 0.31, top - 0.02), (width + 0.02, 0.63, 0.04), "stone:charcoal"),
        box((0, 0.01, top + 0.29), (width, 0.02, 0.58), "tiles:sky"),
        box((0, 0.17, 1.83), (width, 0.34, 0.66), plain, plain, face, plain, plain, plain),
        box((-width * 0.25, 0.60, 0.50), (0.56, 0.02, 0.56), "screen"),
        box((-width * 0.25, 0.31, top + 0.01), (0.56, 0.50, 0.02), "metal:charcoal"),
        box((width * 0.2, 0.30, top + 0.005), (0.60, 0.42, 0.012), "metal:grey"),
        cylinder((width * 0.2, 0.10, top + 0.14), 0.015, 0.28, "metal:grey"),
        box((width * 0.2, 0.17, top + 0.27), (0.02, 0.16, 0.02), "metal:grey"),
        cylinder((-width * 0.25 - 0.13, 0.38, top + 0.10), 0.11, 0.16, "glazed:red"),
        cylinder((-width * 0.25 + 0.14, 0.22, top + 0.07), 0.09, 0.10, "metal:grey"),
        box((0, 0.25, top + 0.12), (0.30, 0.26, 0.24), "metal:charcoal", angle_deg=4),
    ]
    x = width * 0.2 + 0.45
    while x < width / 2 - 0.06:
        tint = ("teal", "mustard", "terracotta", "cream")[int(rng.integers(4))]
        tall = float(rng.uniform(0.12, 0.26))
        parts.append(cylinder((x, 0.16, top + tall / 2), 0.045, tall, f"glazed:{tint}"))
        x += float(rng.uniform(0.10, 0.16))
    return parts


def fridge(front: str) -> list[Primitive]:
    """A fridge with magnets and notes on its door, a bowl on top."""
    body = f"metal:{front}"
    return [
        box((0, 0.32, 0.92), (0.62, 0.62, 1.84), body),
        box((0, 0.632, 1.22), (0.60, 0.01, 0.01), "metal:charcoal"),
        cylinder((0.24, 0.66, 1.05), 0.012, 0.24, "metal:grey"),
        box((-0.05, 0.633, 1.48), (0.24, 0.006, 0.30), "poster"),
        box((0.12, 0.633, 1.62), (0.12, 0.006, 0.12), "painting"),
        box((-0.12, 0.633, 0.95), (0.16, 0.006, 0.22), "poster"),
        ball((0.02, 0.30, 1.90), (0.16, 0.16, 0.08), "glazed:sky"),
    ]


def dining_set(length: float, wood: str, cover: str, seats: int) -> list[Primitive]:
    """A table along x with `seats` chairs on either side, set for a meal."""
    parts = [*table(length, 0.85, 0.75, wood), box((0, 0, 0.756), (length, 0.30, 0.008), cover)]
    for k in range(seats):
        x = length * ((k + 0.5) / seats - 0.5)
        parts += Placement(x, -0.82, 4 * (-1) ** k).place(chair(wood, cover))
        parts += Placement(x, 0.82, 180 - 5 * (-1) ** k).place(chair(wood, cover))
        for side in (-1, 1):
            parts.append(cylinder((x, side * 0.27, 0.76), 0.12, 0.018, "glazed:navy"))
            parts.append(cylinder((x + 0.19, side * 0.22, 0.80), 0.035, 0.10, "glazed:teal"))
    parts.append(ball((0, 0, 0.83), (0.17, 0.17, 0.08), "glazed:terracotta"))
    for k in range(5):
        a = 1.26 * k
        parts.append(ball((0.08 * np.cos(a), 0.08 * np.sin(a), 0.91), (0.04, 0.04, 0.04),
                          ("stone:red", "stone:green", "stone:mustard")[k % 3]))  # fmt: skip
    return parts


def piano(wood: str) -> list[Primitive]:
    """An upright piano with a stool, music and a metronome."""
    return [
        box((0, 0.20, 0.62), (1.48, 0.36, 1.24), wood),
        box((0, 0.26, 0.68), (1.48, 0.60, 0.16), wood),
        box((0, 0.47, 0.763), (1.24, 0.15, 0.012), "keys"),
        box((0, 0.40, 0.93), (0.52, 0.02, 0.30), "screen", lean_deg=12),
        box((-0.66, 0.50, 0.30), (0.08, 0.08, 0.60), wood),
        box((0.66, 0.50, 0.30), (0.08, 0.08, 0.60), wood),
        box((0.45, 0.20, 1.33), (0.12, 0.12, 0.18), "wood:oak", angle_deg=12),
        *Placement(-0.4, 0.2, 5, 1.56).place(
            [box((0, 0, 0), (0.40, 0.03, 0.30), "painting", lean_deg=-6)]
        ),
        *Placement(-0.40, 0.2, 0, 1.24).place([box((0, 0, 0.09), (0.30, 0.10, 0.18), "wood:oak")]),
        cylinder((0, 0.95, 0.25), 0.05, 0.50, "metal:charcoal"),
        cylinder((0, 0.95, 0.52), 0.18, 0.06, "fabric:red"),
    ]


def toys(rng: np.random.Generator) -> list[Primitive]:
    """Building blocks, balls and boxes about the origin, within 0.9 m."""
    parts = []
    for k in range(16):
        a, r = 2.4 * k, 0.22 * np.sqrt(k)
        size = float(rng.uniform(0.08, 0.20))
        at = (r * np.cos(a), r * np.sin(a), size / 2 + 0.012)
        tint = ("red", "teal", "mustard", "sky", "green", "rose")[k % 6]
        if k % 4 == 3:
            parts.append(ball(at, (size / 2,) * 3, f"glazed:{tint}"))
        else:
            parts.append(box(at, (size,) * 3, f"wood:{tint}", angle_deg=float(rng.uniform(0, 90))))
    return parts


def coat_rack(width: float, rng: np.random.Generator) -> list[Primitive]:
    """Coats and hats on hooks along a wall at y = 0, shoes below."""
    parts = [box((0, 0.02, 1.72), (width, 0.03, 0.12), "wood:walnut")]
    hooks = round(width / 0.24)
    for k in range(hooks):
        x = width * ((k + 0.5) / hooks - 0.5)
        tint = ("navy", "terracotta", "mustard", "charcoal", "teal", "rose")[int(rng.integers(6))]
        tall = float(rng.uniform(0.75, 1.05))
        parts.append(ball((x, 0.12, 1.68 - tall / 2), (0.13, 0.09, tall / 2), f"fabric:{tint}"))
        shoe = ("charcoal", "walnut", "red", "sky")[int(rng.integers(4))]
        for side in (-0.05, 0.05):
            parts.append(ball((x + side, 0.18, 0.05), (0.045, 0.14, 0.05), f"stone:{shoe}"))
    return parts


def closed_door() -> list[Primitive]:
    """A door leaf in its frame."""
    sides = [box((s * 0.49, 0.01, 1.05), (0.08, 0.05, 2.10), "wood:white") for s in (-1, 1)]
    return [
        *sides,
        box((0, 0.01, 2.09), (1.06, 0.05, 0.08), "wood:white"),
        box((0, 0.01, 1.02), (0.90, 0.03, 2.02), "panels:oak"),
        ball((0.36, 0.06, 1.02), (0.05, 0.03, 0.02), "metal:brass"),
    ]
