"""The true trajectory and mesh of a source. Only the evaluator may import this module."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory, read_tum
from hsslam_node.sources.files.scannet_scene import ScanNetScene
from hsslam_node.sources.options import SourceOptions
from hsslam_node.sources.replica import ReplicaFolder
from hsslam_node.sources.synth.scenes import SCENES
from hsslam_node.sources.synth.synth_source import synth_truth
from hsslam_node.sources.tum import MAX_DT_NS, TumFolder, associate


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
    kind, _, rest = spec.partition(":")
    if kind == "synth" and rest in SCENES:
        trajectory, load_mesh = synth_truth(rest, options)
        return GroundTruth(trajectory, load_mesh)
    if kind == "tum" and rest:
        return _tum_truth(TumFolder.find(rest), options)
    if kind == "replica" and rest:
        return _replica_truth(ReplicaFolder.find(rest), options)
    if kind == "scannet" and rest:
        return _scannet_truth(ScanNetScene.find(rest), options)
    return None


def _tum_truth(folder: TumFolder, options: SourceOptions) -> GroundTruth | None:
    path = folder.path / "groundtruth.txt"
    if not path.exists():
        return None
    truth = read_tum(path)
    frames = np.array([folder.pairs[i][0] for i in options.selected(len(folder.pairs))])
    pairs = associate(frames, truth.stamps_ns, MAX_DT_NS)
    if not pairs:
        raise UserError(f"{path}: no pose within 20 ms of a frame of rgb.txt")
    frame_rows, truth_rows = map(list, zip(*pairs, strict=True))
    return GroundTruth(Trajectory(frames[frame_rows], truth.T_world_cam[truth_rows]))


def _replica_truth(folder: ReplicaFolder, options: SourceOptions) -> GroundTruth | None:
    path = folder.trajectory_file
    if not path.exists():
        return None
    poses = _read_matrices(path)
    if len(poses) < len(folder.pairs):
        raise UserError(f"{path}: {len(poses)} poses: expected {len(folder.pairs)}, one a frame")
    rows = list(options.selected(len(folder.pairs)))
    stamps = np.array([folder.pairs[i][0] for i in rows], np.int64)
    mesh_file = folder.mesh_file
    load_mesh = None if mesh_file is None else lambda: _load_mesh(mesh_file)
    return GroundTruth(Trajectory(stamps, poses[rows]), load_mesh)


def _scannet_truth(scene: ScanNetScene, options: SourceOptions) -> GroundTruth | None:
    """Frames whose pose the scene's authors could not tell (-inf) have no truth; None: no frame has."""
    rows = np.array(options.selected(len(scene.numbers())), np.int64)
    poses = scene.T_world_cam()[rows]
    known = np.isfinite(poses).all(axis=(1, 2))
    if not known.any():
        return None
    mesh_file = scene.mesh_file
    load_mesh = None if mesh_file is None else lambda: _load_mesh(mesh_file)
    return GroundTruth(Trajectory(scene.stamps_ns()[rows][known], poses[known]), load_mesh)


def _read_matrices(path: Path) -> np.ndarray:
    try:
        rows = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise UserError(f"{path}: {error}: expected 16 numbers a line") from None
    if rows.shape[1] != 16 or not np.isfinite(rows).all():
        raise UserError(f"{path}: {rows.shape[1]} columns: expected 16 finite numbers a line")
    return rows.reshape(-1, 4, 4)


def _load_mesh(path: Path) -> trimesh.Trimesh:
    mesh = trimesh.load(path, process=False, force="mesh")
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise UserError(f"{path}: holds no triangles: expected a mesh")
    return mesh
