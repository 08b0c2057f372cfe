"""Prints a map's answers for points as a table or JSON."""

import json

import numpy as np
from rich.console import Console
from rich.table import Table

from hsslam_node.dense_map.answers import MapAnswers

_WIDTH = 100
_HEADS = ("x, m", "y, m", "z, m", "distance, m", "gradient", "known", "certainty")


def print_answers(points: np.ndarray, answers: MapAnswers, *, as_json: bool) -> None:
    """Print one row for each of the points [N, 3] m."""
    if as_json:
        print(json.dumps([_record(points[k], answers, k) for k in range(len(points))], indent=1))
        return
    table = Table(box=None, padding=(0, 2, 0, 0))
    for head in _HEADS:
        table.add_column(head, justify="right", no_wrap=True)
    for k, point in enumerate(points):
        table.add_row(
            *(f"{metres:g}" for metres in point),
            f"{answers.distance_m[k]:.3f}" if answers.known[k] else "-",
            " ".join(f"{round(float(part), 2) + 0.0:.2f}" for part in answers.gradient[k]),  # no -0
            "yes" if answers.known[k] else "no",
            f"{answers.certainty[k]:.2f}",
        )
    Console(highlight=False, width=_WIDTH).print(table)


def _record(point: np.ndarray, answers: MapAnswers, k: int) -> dict[str, object]:
    return {
        "point": [float(metres) for metres in point],
        "distance_m": float(answers.distance_m[k]) if answers.known[k] else None,
        "gradient": [float(part) for part in answers.gradient[k]],
        "known": bool(answers.known[k]),
        "certainty": float(answers.certainty[k]),
    }
