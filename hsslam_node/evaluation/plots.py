"""Pictures of an evaluation: path against truth, error over time, meshes coloured by their error."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from hsslam_node.errors import UserError
from hsslam_node.evaluation.evaluate import Evaluation
from hsslam_node.evaluation.mesh.mesh_picture import MeshPicture
from hsslam_node.evaluation.trajectory.ate import AteResult, associated
from hsslam_node.geometry.se3 import transformed
from hsslam_node.geometry.trajectory import Trajectory

_DPI = 110
_WORST_CM = 5.0  # end of the colour scale
_COLORS = {"online": "#ff7f0e", "final": "#1f77b4", "keyframes": "#2ca02c"}


def draw_plots(
    evaluation: Evaluation, trajectories: Mapping[str, Trajectory], folder: Path
) -> list[Path]:
    """Write trajectory.png, error.png and, if the true surface and a true pose are known, mesh.png.

    Raises:
        UserError: the folder cannot be written.
    """
    matplotlib.use("Agg")
    figures: dict[str, Figure] = {}
    if evaluation.truth is not None and evaluation.ates:
        figures["trajectory"] = _paths(evaluation, trajectories)
        figures["error"] = _errors(evaluation.ates)
    judge = evaluation.judge
    if judge is not None and evaluation.meshes and len(judge.given.T_world_cam):
        figures["mesh"] = _meshes(evaluation)
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            written.append(folder / f"{name}.png")
            figure.savefig(written[-1], dpi=_DPI)
    except OSError as error:
        raise UserError(f"--plots {folder}: {error.strerror}: expected a folder to write") from None
    return written


def _paths(evaluation: Evaluation, trajectories: Mapping[str, Trajectory]) -> Figure:
    """The paths on the two axes of the truth's world along which it extends most."""
    truth = evaluation.truth
    assert truth is not None
    positions = truth.trajectory.positions
    axes_by_extent = np.argsort(-np.ptp(positions, axis=0))
    i, j = sorted(int(axis) for axis in axes_by_extent[:2])
    figure = Figure((8, 6.5), layout="constrained")
    axes = figure.subplots()
    axes.plot(positions[:, i], positions[:, j], color="black", label="truth", linewidth=2.5)
    for label in ("online", "final"):
        if label not in evaluation.ates:
            continue
        T = evaluation.ates[label].T_truth_estimate
        scored, _ = associated(trajectories[label], truth.trajectory)
        moved = transformed(T, scored.positions)
        axes.plot(moved[:, i], moved[:, j], color=_COLORS[label], label=label, linewidth=1.2)
    axes.set(xlabel=f"{'xyz'[i]}, m", ylabel=f"{'xyz'[j]}, m", aspect="equal")
    axes.legend()
    return figure


def _errors(ates: Mapping[str, AteResult]) -> Figure:
    figure = Figure((9, 4), layout="constrained")
    axes = figure.subplots()
    start_ns = min((int(a.stamps_ns[0]) for a in ates.values() if len(a.stamps_ns)), default=0)
    for label, result in ates.items():
        seconds = (result.stamps_ns - start_ns) / 1e9
        name = f"{label}: RMSE {100 * result.rmse_m:.2f} cm, {result.scored}/{result.expected}"
        style: dict[str, Any] = (
            {"marker": ".", "linestyle": "none"} if label == "keyframes" else {"linewidth": 1.2}
        )
        axes.plot(seconds, 100 * result.errors_m, label=name, color=_COLORS.get(label), **style)
    axes.set(xlabel="time, s", ylabel="distance to the true camera centre, cm")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize=8)
    return figure


def _meshes(evaluation: Evaluation) -> Figure:
    """One row a mesh: from above by error, then inside views in colour, shaded and by error."""
    assert evaluation.judge is not None
    rows = {name: MeshPicture(mesh, evaluation.judge) for name, mesh in evaluation.meshes.items()}
    figure = Figure((18, 4.1 * len(rows)), layout="constrained")
    grid: Any = figure.subplots(len(rows), 4, squeeze=False)
    for line, (name, picture) in zip(grid, rows.items(), strict=True):
        images = {
            "from above, by error": picture.from_above(_WORST_CM / 100),
            "colour": picture.inside("color"),
            "shape": picture.inside("shape"),
            "error": picture.inside("error", _WORST_CM / 100),
        }
        for axes, (title, image) in zip(line, images.items(), strict=True):
            axes.imshow(image)
            axes.set_title(f"{name}: {title}", fontsize=9)
            axes.set_axis_off()
    scale = ScalarMappable(Normalize(0, _WORST_CM), "turbo")
    figure.colorbar(scale, ax=grid, label="distance to the true surface, cm", shrink=0.7)
    return figure
