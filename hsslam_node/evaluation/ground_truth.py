"""The true trajectory and mesh of a source. Only the evaluator may import this module."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import trimesh

from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.options import SourceOptions
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source_row import find_row, imported, source_name


@dataclass(frozen=True)
class GroundTruth:
    """One true pose for every frame that the source delivers and that has one.

    `trajectory` is camera-to-world in the truth's own world frame, stamped like the frames.
    """

    trajectory: Trajectory
    load_mesh: Callable[[], trimesh.Trimesh] | None = None

    @property
    def stamps_ns(self) -> np.ndarray:
        return self.trajectory.stamps_ns  # [N] int64

    @property
    def T_world_cam(self) -> np.ndarray:
        return self.trajectory.T_world_cam  # [N, 4, 4] float64

    def mesh(self) -> trimesh.Trimesh | None:
        """The true surface in the truth's world frame, None where it is not known."""
        return self.load_mesh() if self.load_mesh else None


def open_ground_truth(spec: str, options: SourceOptions | None = None) -> GroundTruth | None:
    """The truth of what `open_source(spec, options)` delivers; None where there is none.

    Raises:
        UserError: the source's files are missing, or the truth is malformed.
    """
    options = options or SourceOptions()
    row = find_row(spec, SOURCES)
    if row is None or row.ground_truth is None:
        return None
    found = imported(row.ground_truth)(source_name(spec), options)
    return None if found is None else GroundTruth(*found)
