"""The true trajectory and mesh of a source. Only the evaluator may import this module."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.effects.restamped import running_stamp_ns
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source_row import find_row, imported, source_name

if TYPE_CHECKING:
    from trimesh import Trimesh


@dataclass(frozen=True)
class GroundTruth:
    """One true pose for every frame that the source delivers and that has one.

    `trajectory` is camera-to-world in the truth's own world frame, stamped like the frames.
    """

    trajectory: Trajectory
    load_mesh: "Callable[[], Trimesh] | None" = None

    @property
    def stamps_ns(self) -> np.ndarray:
        return self.trajectory.stamps_ns  # [N] int64

    @property
    def T_world_cam(self) -> np.ndarray:
        return self.trajectory.T_world_cam  # [N, 4, 4] float64

    def mesh(self) -> "Trimesh | None":
        """The true surface in the truth's world frame, None if it is not known."""
        return self.load_mesh() if self.load_mesh else None


def open_ground_truth(spec: str, options: SourceOptions | None = None) -> GroundTruth | None:
    """The truth of the frames of `open_source(spec, options)`; None if there is none.

    For repeated frames it is known only if every frame has a true pose.

    Raises:
        UserError: the source's files are missing, or the truth is malformed.
    """
    options = options or SourceOptions()
    row = find_row(spec, SOURCES)
    if row is None or row.ground_truth is None:
        return None
    found = imported(row.ground_truth)(source_name(spec), options)
    if found is None:
        return None
    truth = GroundTruth(*found)
    return _restamped(truth, spec, options) if options.reorders else truth


def _restamped(truth: GroundTruth, spec: str, options: SourceOptions) -> GroundTruth | None:
    """The truth with the stamps of `Restamped`; None if frames lack a true pose."""
    source = open_source(spec, replace(options, noise="none"))
    poses = truth.T_world_cam
    if len(poses) != source.frame_count:
        return None
    stamps_ns = np.array([running_stamp_ns(n, source.rate_hz) for n in range(len(poses))], np.int64)
    return replace(truth, trajectory=Trajectory(stamps_ns, poses))
