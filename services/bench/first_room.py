"""The part of a run's mesh that its first frames saw, against the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.evaluation.ate import ate
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh_metrics import MeshMetrics, compare_meshes
from hsslam_node.evaluation.visibility import Views
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import SourceOptions

_EVERY = 10  # frames between the views
_TOLERANCE_M = 0.03
_SAMPLES = 100_000


@dataclass(frozen=True)
class FirstRoom:
    """What the first frames of a source saw, with its true surface."""

    mesh: trimesh.Trimesh
    truth: Trajectory  # of those frames
    views: Views


def first_room(spec: str, frames: int) -> FirstRoom:
    """The truth of the first frames of a source that has a true mesh; views without noise."""
    options = SourceOptions(frames=frames)
    truth = open_ground_truth(spec, options)
    mesh = truth.mesh() if truth else None
    if truth is None or mesh is None:
        raise ValueError(f"{spec}: expected a source with a true mesh")
    source = open_source(spec, SourceOptions(frames=-(-frames // _EVERY), stride=_EVERY))
    seen = [frame for frame in source.frames() if isinstance(frame, Frame)]
    row_of = {int(stamp): row for row, stamp in enumerate(truth.stamps_ns)}
    poses = truth.T_world_cam[[row_of[frame.stamp_ns] for frame in seen]]
    depths_m = np.stack([frame.depth_m() for frame in seen])
    views = Views(source.camera, poses, depths_m, _TOLERANCE_M)
    return FirstRoom(mesh, Trajectory(truth.stamps_ns[:frames], truth.T_world_cam[:frames]), views)


def score_first_room(room: FirstRoom, run: Path) -> MeshMetrics:
    """Distances of the mesh of a run folder, brought to the truth by the poses of those frames alone."""
    mesh = trimesh.load(run / "mesh.ply", process=False, force="mesh")
    assert isinstance(mesh, trimesh.Trimesh)
    aligned = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    aligned.apply_transform(ate(read_tum(run / "trajectory.txt"), room.truth).T_truth_estimate)
    return compare_meshes(aligned, room.mesh, room.views, samples=_SAMPLES)
