"""Plots of a batch: the figures of all logs, and their changes against another batch."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Picture

from hsslam_batch.results.comparison import FIGURES, Change, Figure, Row
from hsslam_node.errors import UserError

_DPI = 110
_COLUMNS, _SIDE_IN = 3, 3.2  # of axes, inches


def draw(batches: Mapping[str, Sequence[Row]], folder: Path) -> list[Path]:
    """Write logs.png into a folder: the distribution of each figure over the logs, a curve a batch.

    Raises:
        UserError: no log is done, or the folder is not writable.
    """
    known = {
        figure: {name: found for name, rows in batches.items() if (found := _values(rows, figure))}
        for figure in FIGURES
    }
    drawn = {figure: found for figure, found in known.items() if found}
    if not drawn:
        raise UserError(f"--plots {folder}: no log is done: expected at least one")
    picture, axes = _panels(len(drawn))
    for each, (figure, found) in zip(axes, drawn.items(), strict=False):
        for name, values in found.items():
            ordered = figure.scale * np.sort(values)
            share = 100 * np.arange(1, len(ordered) + 1) / len(ordered)
            color = f"C{list(batches).index(name)}"
            each.step(ordered, share, where="post", label=name, color=color)
        each.set(xlabel=figure.title, ylabel="share of the logs, %", ylim=(0, 101))
    if len(batches) > 1:
        shown = [zip(*each.get_legend_handles_labels(), strict=True) for each in axes]
        by_name = {name: handle for pairs in shown for handle, name in pairs}
        picture.legend(by_name.values(), by_name, loc="outside upper center", ncols=2)
    return [_write(picture, folder, "logs.png")]


def draw_changes(changes: Sequence[Change], noise: float, folder: Path) -> list[Path]:
    """Write changes.png: each log of both batches, before against after, with the band of `noise`.

    Raises:
        UserError: the folder is not writable.
    """
    drawn = [change for change in changes if change.median_ratio is not None]
    if not drawn:
        return []
    picture, axes = _panels(len(drawn))
    for each, change in zip(axes, drawn, strict=False):
        scale, worse = change.figure.scale, set(change.worse)
        end = 1.05 * scale * max(max(pair.before, pair.after) for pair in change.pairs)
        band = ((0, end / (1 + noise)), (0, end * (1 + noise)))
        each.fill_between((0, end), *band, color="#7f7f7f", alpha=0.15)
        each.axline((0, 0), slope=1, color="black", linewidth=0.8)
        for is_worse, color in ((False, "#1f77b4"), (True, "#d62728")):
            pairs = [pair for pair in change.pairs if (pair in worse) == is_worse]
            before = [scale * pair.before for pair in pairs]
            after = [scale * pair.after for pair in pairs]
            each.scatter(before, after, s=12, color=color)
        each.set(xlabel=f"{change.figure.title}: before", ylabel="after")
        each.set(xlim=(0, end), ylim=(0, end))
    return [_write(picture, folder, "changes.png")]


def _panels(count: int) -> tuple[Picture, list[Axes]]:
    """A picture with `count` axes."""
    matplotlib.use("Agg")
    columns = min(_COLUMNS, count)
    rows = math.ceil(count / columns)
    picture = Picture((columns * _SIDE_IN, rows * _SIDE_IN), layout="constrained")
    axes = list(picture.subplots(rows, columns, squeeze=False).flat)
    for spare in axes[count:]:
        spare.remove()
    return picture, axes[:count]


def _write(picture: Picture, folder: Path, name: str) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        picture.savefig(folder / name, dpi=_DPI)
    except OSError as error:
        raise UserError(f"--plots {folder}: {error.strerror}: expected a folder to write") from None
    return folder / name


def _values(rows: Sequence[Row], figure: Figure) -> list[float]:
    done = [row for row in rows if row["kind"] == "done"]
    return [value for row in done if (value := figure.value(row)) is not None]
