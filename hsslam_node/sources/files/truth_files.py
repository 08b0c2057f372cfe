"""Poses and meshes that come with a recording, as a row's `ground_truth` returns them to the evaluator."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.geometry.triangles import triangle_mesh

if TYPE_CHECKING:
    import trimesh

MeshLoader = Callable[[], "trimesh.Trimesh"]
Truth = tuple[Trajectory, MeshLoader | None]
"""Camera-to-world poses with the stamps of the frames that have one, and the mesh (m) in the same world."""


def mesh_loader(path: Path | None) -> MeshLoader | None:
    """Returns a function that reads the mesh; UserError if it is none. None without a file."""
    return None if path is None else lambda: triangle_mesh(path, "expected a mesh")


def read_matrix(path: Path) -> np.ndarray:
    """A text file of four lines of four numbers, [4, 4] float64; the numbers may be infinite or NaN.

    Raises:
        UserError: the file cannot be read or holds something else.
    """
    try:
        matrix = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        text = " ".join(str(error).split())
        raise UserError(f"{path}: {text}: expected four lines of four numbers") from None
    if matrix.shape != (4, 4):
        shape = "x".join(map(str, matrix.shape))
        raise UserError(f"{path}: {shape} numbers: expected four lines of four")
    return matrix


def read_matrices(path: Path) -> np.ndarray:
    """A text file of 16 numbers a line, row-major, [N, 4, 4] float64.

    Raises:
        UserError: the file cannot be read, or a line holds something else.
    """
    try:
        rows = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {error}: expected 16 numbers a line") from None
    if rows.shape[1] != 16 or not np.isfinite(rows).all():
        raise UserError(f"{path}: {rows.shape[1]} columns: expected 16 finite numbers a line")
    return rows.reshape(-1, 4, 4)
