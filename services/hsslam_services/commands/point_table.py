"""Prints a map's answers for points as a table or JSON."""

import json
from collections.abc import Iterator

import numpy as np

from hsslam_node.dense_map.answers import MapAnswers

_HEADS = ("x, m", "y, m", "z, m", "distance, m", "gradient", "known", "certainty")


def print_answers(points: np.ndarray, answers: MapAnswers, *, as_json: bool) -> None:
    """Print one row for each of the points [N, 3] m."""
    if as_json:
        print(json.dumps([_record(points[k], answers, k) for k in range(len(points))], indent=1))
        return
    rows = [_HEADS, *_rows(points, answers)]  # not by rich, which takes 1 ms a row
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))


def _rows(points: np.ndarray, answers: MapAnswers) -> Iterator[tuple[str, ...]]:
    gradient = answers.gradient.round(2) + 0.0  # no -0
    for k, point in enumerate(points.tolist()):
        yield (
            *(f"{metres:g}" for metres in point),
            f"{answers.distance_m[k]:.3f}" if answers.known[k] else "-",
            " ".join(f"{part:.2f}" for part in gradient[k]),
            "yes" if answers.known[k] else "no",
            f"{answers.certainty[k]:.2f}",
        )


def _record(point: np.ndarray, answers: MapAnswers, k: int) -> dict[str, object]:
    return {
        "point": [float(metres) for metres in point],
        "distance_m": float(answers.distance_m[k]) if answers.known[k] else None,
        "gradient": [float(part) for part in answers.gradient[k]],
        "known": bool(answers.known[k]),
        "certainty": float(answers.certainty[k]),
    }
