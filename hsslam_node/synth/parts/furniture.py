"""Pieces of furniture, each in its own frame: origin on the floor, back to -y, front to +y."""

import numpy as np

from hsslam_node.synth.parts.placement import Placement, ball, box, cylinder
from hsslam_node.synth.parts.primitive import Primitive


def sofa(width: float, cover: str, accents: tuple[str, str]) -> list[Primitive]:
    """A sofa with arms, seat and back cushions, and two scatter cushions."""
    seat = (width - 0.44) / 2
    parts = [
        box((0, 0.43, 0.19), (width, 0.86, 0.26), cover),
        box((0, 0.11, 0.52), (width, 0.22, 0.62), cover),
        box((-width / 2 + 0.11, 0.45, 0.42), (0.22, 0.82, 0.36), cover),
        box((width / 2 - 0.11, 0.45, 0.42), (0.22, 0.82, 0.36), cover),
    ]
    for side in (-1, 1):
        parts.append(box((side * seat / 2, 0.52, 0.40), (seat - 0.02, 0.64, 0.18), cover))
        parts.append(
            box((side * seat / 2, 0.27, 0.66), (seat - 0.04, 0.16, 0.42), cover, lean_deg=10)
        )
        for y in (0.07, 0.79):
            parts.append(cylinder((side * (width / 2 - 0.07), y, 0.03), 0.025, 0.06, "wood:walnut"))
    parts.append(ball((-width * 0.27, 0.46, 0.64), (0.23, 0.09, 0.19), accents[0], angle_deg=14))
    parts.append(ball((width * 0.24, 0.47, 0.63), (0.21, 0.09, 0.18), accents[1], angle_deg=-18))
    return parts


def table(width: float, depth: float, height: float, wood: str) -> list[Primitive]:
    """A table with an apron and four legs, centred on its origin."""
    parts = [
        box((0, 0, height - 0.02), (width, depth, 0.04), wood),
        box((0, 0, height - 0.08), (width - 0.14, depth - 0.14, 0.08), wood),
    ]
    for sx in (-1, 1):
        for sy in (-1, 1):
            center = (sx * (width / 2 - 0.07), sy * (depth / 2 - 0.07), (height - 0.04) / 2)
            parts.append(box(center, (0.06, 0.06, height - 0.04), wood))
    return parts


def chair(wood: str, cover: str) -> list[Primitive]:
    """A chair with a padded seat and a slatted back at -y."""
    parts = [box((0, 0.22, 0.45), (0.42, 0.42, 0.05), cover)]
    for sx in (-1, 1):
        parts.append(box((sx * 0.18, 0.40, 0.215), (0.04, 0.04, 0.43), wood))
        parts.append(box((sx * 0.18, 0.03, 0.46), (0.04, 0.04, 0.92), wood))
    for z in (0.58, 0.72, 0.86):
        parts.append(box((0, 0.03, z), (0.36, 0.02, 0.08), wood))
    return parts


def bookshelf(width: float, height: float, wood: str, rng: np.random.Generator) -> list[Primitive]:
    """A bookshelf full of books, some of them leaning, with a few ornaments."""
    depth, board = 0.30, 0.03
    parts = [
        box((0, 0.01, height / 2), (width, 0.02, height), wood),
        box((-width / 2 + board / 2, depth / 2, height / 2), (board, depth, height), wood),
        box((width / 2 - board / 2, depth / 2, height / 2), (board, depth, height), wood),
    ]
    shelves = round(height / 0.38)
    pitch = (height - board) / shelves
    for k in range(shelves + 1):
        parts.append(box((0, depth / 2, board / 2 + k * pitch), (width, depth, board), wood))
    for k in range(shelves):
        parts += _books(width - 2 * board, board + k * pitch, pitch - board, rng)
    return parts


def _books(width: float, floor: float, room: float, rng: np.random.Generator) -> list[Primitive]:
    parts, x = [], -width / 2 + 0.01
    while x < width / 2 - 0.10:
        if rng.random() < 0.14:
            radius = float(rng.uniform(0.04, 0.06))
            tint = ("teal", "mustard", "terracotta", "sky")[int(rng.integers(4))]
            parts.append(
                cylinder((x + radius + 0.02, 0.17, floor + 0.07), radius, 0.14, f"glazed:{tint}")
            )
            x += 2 * radius + 0.05
            continue
        thick, tall = float(rng.uniform(0.03, 0.065)), float(rng.uniform(0.55, 0.86)) * room
        deep = float(rng.uniform(0.16, 0.23))
        parts.append(
            box((x + thick / 2, 0.03 + deep / 2, floor + tall / 2), (thick, deep, tall), "book")
        )
        x += thick + (0.002 if rng.random() < 0.85 else float(rng.uniform(0.03, 0.09)))
    return parts


def desk(width: float, wood: str) -> list[Primitive]:
    """A desk with a drawer block, a monitor, a keyboard, a mug, books and a lamp."""
    top = 0.74
    parts = [
        box((0, 0.34, top - 0.02), (width, 0.68, 0.04), wood),
        box((width / 2 - 0.22, 0.34, 0.35), (0.40, 0.60, 0.70), "panels:cream"),
        box((-width / 2 + 0.04, 0.34, 0.35), (0.05, 0.62, 0.70), wood),
        box((-0.05, 0.16, top + 0.30), (0.62, 0.03, 0.38), "metal:charcoal", "metal:charcoal",
            "screen", "metal:charcoal", "metal:charcoal", "metal:charcoal"),
        cylinder((-0.05, 0.14, top + 0.06), 0.025, 0.12, "metal:grey"),
        cylinder((-0.05, 0.16, top + 0.008), 0.11, 0.016, "metal:grey"),
        box((-0.05, 0.48, top + 0.012), (0.44, 0.14, 0.024), "screen"),
        cylinder((0.36, 0.46, top + 0.05), 0.042, 0.10, "glazed:red"),
        box((0.52, 0.22, top + 0.03), (0.24, 0.17, 0.06), "book:navy", angle_deg=12),
        box((0.53, 0.22, top + 0.085), (0.22, 0.16, 0.05), "book:terracotta", angle_deg=-7),
    ]  # fmt: skip
    return [*parts, *Placement(-0.58, 0.2, z=top).place(table_lamp("mustard"))]


def table_lamp(shade: str) -> list[Primitive]:
    """A lamp with a pottery foot."""
    return [
        ball((0, 0, 0.12), (0.08, 0.08, 0.12), "glazed:teal"),
        cylinder((0, 0, 0.27), 0.012, 0.12, "metal:brass"),
        cylinder((0, 0, 0.42), 0.14, 0.20, f"fabric:{shade}"),
    ]


def floor_lamp(shade: str) -> list[Primitive]:
    """A lamp on a pole."""
    return [
        cylinder((0, 0, 0.015), 0.15, 0.03, "metal:charcoal"),
        cylinder((0, 0, 0.75), 0.014, 1.46, "metal:brass"),
        cylinder((0, 0, 1.55), 0.20, 0.30, f"fabric:{shade}"),
    ]


def plant(height: float, rng: np.random.Generator) -> list[Primitive]:
    """A potted shrub."""
    parts = [
        cylinder((0, 0, 0.17), 0.17, 0.34, "glazed:terracotta"),
        cylinder((0, 0, 0.45), 0.022, 0.50, "wood:walnut"),
    ]
    for k in range(9):
        angle, reach = 2.4 * k, 0.16 * np.sqrt(k / 8)
        z = height - 0.25 - 0.40 * reach / 0.16 * rng.uniform(0.4, 1.0)
        size = rng.uniform(0.11, 0.17, 3)
        parts.append(ball((reach * np.cos(angle), reach * np.sin(angle), z), size, "leaves:green"))
    return parts


def cabinet(width: float, height: float, depth: float, wood: str) -> list[Primitive]:
    """A low cabinet with panelled doors at +y, on feet."""
    w = wood
    parts = [
        box((0, depth / 2, height / 2 + 0.04), (width, depth, height - 0.08),
            w, w, f"panels:{w.partition(':')[2]}", w, w, w),
        box((0, depth / 2, height - 0.015), (width + 0.04, depth + 0.03, 0.03), w),
    ]  # fmt: skip
    for sx in (-1, 1):
        parts.append(box((sx * (width / 2 - 0.06), depth / 2, 0.04), (0.06, depth - 0.06, 0.08), w))
        parts.append(cylinder((sx * 0.05, depth + 0.01, height * 0.55), 0.012, 0.12, "metal:brass"))
    return parts


def armchair(cover: str, accent: str) -> list[Primitive]:
    """A low armchair with a cushion."""
    parts = [
        box((0, 0.40, 0.21), (0.80, 0.76, 0.24), cover),
        box((0, 0.10, 0.52), (0.80, 0.20, 0.66), cover, lean_deg=6),
        box((0, 0.46, 0.38), (0.50, 0.60, 0.14), accent),
        ball((0.05, 0.30, 0.60), (0.20, 0.09, 0.17), accent, angle_deg=10),
    ]
    for side in (-1, 1):
        parts.append(box((side * 0.33, 0.42, 0.40), (0.15, 0.74, 0.40), cover))
        for y in (0.08, 0.72):
            parts.append(cylinder((side * 0.34, y, 0.05), 0.022, 0.10, "wood:walnut"))
    return parts


def dresser(width: float, wood: str) -> list[Primitive]:
    """A chest of drawers with a globe, a box and a vase on it."""
    front = f"panels:{wood.partition(':')[2]}"
    parts = [
        box((0, 0.22, 0.44), (width, 0.44, 0.80), wood, wood, front, wood, wood, wood),
        box((0, 0.22, 0.855), (width + 0.04, 0.48, 0.03), wood),
        cylinder((-width * 0.28, 0.2, 0.885), 0.09, 0.03, "wood:walnut"),
        ball((-width * 0.28, 0.2, 1.04), (0.14, 0.14, 0.14), "stone:sky"),
        box((width * 0.05, 0.22, 0.93), (0.26, 0.2, 0.12), "cardboard", angle_deg=15),
        ball((width * 0.33, 0.2, 0.99), (0.075, 0.075, 0.12), "glazed:mustard"),
        cylinder((width * 0.33, 0.2, 1.13), 0.03, 0.08, "glazed:mustard"),
    ]
    for sx in (-1, 1):
        parts.append(box((sx * (width / 2 - 0.05), 0.22, 0.02), (0.06, 0.40, 0.04), wood))
        for z in (0.30, 0.58):
            parts.append(cylinder((sx * width / 4, 0.46, z), 0.02, 0.02, "metal:brass"))
    return parts


def coffee_table(wood: str) -> list[Primitive]:
    """A low table with books, a bowl and a cup."""
    return [
        *table(1.0, 0.55, 0.40, wood),
        box((-0.26, 0.04, 0.42), (0.28, 0.21, 0.04), "book:teal", angle_deg=14),
        box((-0.25, 0.05, 0.455), (0.25, 0.18, 0.03), "book:rose", angle_deg=-6),
        ball((0.16, -0.02, 0.45), (0.14, 0.14, 0.06), "glazed:terracotta"),
        cylinder((0.38, 0.14, 0.445), 0.04, 0.09, "glazed:navy"),
    ]


def framed(width: float, height: float, picture: str, depth: float = 0.03) -> list[Primitive]:
    """Something flat that hangs on a wall at y = 0, centred on its origin."""
    return [box((0, depth / 2, 0), (width, depth, height), "wood:walnut", "wood:walnut", picture,
                "wood:walnut", "wood:walnut", "wood:walnut")]  # fmt: skip
