"""Sequences in Replica layout."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.sources.download.data_folder import possible_places
from hsslam_node.sources.files.camera_file import read_replica_camera
from hsslam_node.sources.files.image_pairs import ImagePairSource
from hsslam_node.sources.files.name_stamp import numbered_stamp_ns
from hsslam_node.sources.files.truth_files import Truth, mesh_loader, read_matrices
from hsslam_node.sources.options.source import SourceOptions

RATE_HZ = 30.0  # the layout has no stamps
_VMAP_CAMERA = Camera(1200, 680, 600.0, 600.0, 599.5, 339.5)  # vMAP's configuration for Replica
_VMAP_UNITS_PER_M = 1000.0


@dataclass(frozen=True)
class ReplicaFolder:
    """A folder with `cam_params.json`, `results/frame*.jpg`, `results/depth*.png`, `traj.txt` as from
    NICE-SLAM, or `rgb/rgb_*.png`, `depth/depth_*.png`, `traj_w_c.txt` as from vMAP (`room_0/imap/00`).
    """

    path: Path

    @classmethod
    def find(cls, name: str) -> "ReplicaFolder":
        """The folder of a path (absolute, here, or in $HSSLAM_DATA).

        Raises:
            UserError: not on disk.
        """
        for path in possible_places(name):
            if path.is_dir():
                return cls(path)
        raise UserError(
            f"source replica:{name}: no such folder here or in $HSSLAM_DATA: expected one with "
            "cam_params.json and results/"
        )

    @property
    def camera_file(self) -> Path:
        """`cam_params.json`, in the folder or, as in the published archive, beside it."""
        own, shared = self.path / "cam_params.json", self.path.parent / "cam_params.json"
        return shared if shared.exists() and not own.exists() else own

    def camera(self) -> tuple[Camera, float]:
        """Camera and depth units per metre; vMAP's folders have no camera file and all the same camera.

        Raises:
            UserError: the file is missing or malformed.
        """
        if self._is_vmap and not self.camera_file.exists():
            return _VMAP_CAMERA, _VMAP_UNITS_PER_M
        return read_replica_camera(self.camera_file)

    @property
    def trajectory_file(self) -> Path:
        """True poses, one line a frame; may not be there."""
        return self.path / ("traj_w_c.txt" if self._is_vmap else "traj.txt")

    @property
    def mesh_file(self) -> Path | None:
        """The mesh of the scene: `mesh.ply`, or `<scene>_mesh.ply` beside the scene's folder."""
        scene = self.path.resolve()
        if self._is_vmap and scene.parent.name == "imap":
            scene = scene.parents[1]
        name = scene.name.replace("_", "")
        beside = (f"{scene.name}_mesh.ply", f"{name}_mesh.ply")
        for path in (self.path / "mesh.ply", *(scene.parent / mesh for mesh in beside)):
            if path.exists():
                return path
        return None

    @cached_property
    def pairs(self) -> list[tuple[int, Path, Path]]:
        """(stamp in ns, colour file, depth file) of every frame number; a file may be missing.

        Raises:
            UserError: there is no frame.
        """
        if self._is_vmap:
            color = _numbered(self.path / "rgb", r"rgb_(\d+)\.png")
            depth = _numbered(self.path / "depth", r"depth_(\d+)\.png")
            names = ("rgb/rgb_{}.png", "depth/depth_{}.png")
        else:
            color = _numbered(self.path / "results", r"frame(\d+)\.(?:jpg|jpeg|png)")
            depth = _numbered(self.path / "results", r"depth(\d+)\.png")
            names = ("results/frame{:06d}.jpg", "results/depth{:06d}.png")
        if not color and not depth:
            expected = f"{names[0].format(0)} and {names[1].format(0)}"
            raise UserError(f"{self.path}: no frames: expected {expected}")
        return [
            (
                numbered_stamp_ns(number, RATE_HZ),
                color.get(number, self.path / names[0].format(number)),
                depth.get(number, self.path / names[1].format(number)),
            )
            for number in sorted(color | depth)
        ]

    @property
    def _is_vmap(self) -> bool:
        return (self.path / "rgb").is_dir() and not (self.path / "results").is_dir()


def _numbered(folder: Path, pattern: str) -> dict[int, Path]:
    """Files by the number in their name."""
    found = {}
    for file in folder.iterdir() if folder.is_dir() else ():
        match = re.fullmatch(pattern, file.name)
        if match:
            found[int(match[1])] = file
    return found


class ReplicaSource(ImagePairSource):
    """A Replica sequence; the layout has no stamps, so frame n is stamped n / 30 s.

    Raises:
        UserError: the folder, its images or its camera are missing or wrong.
    """

    numbered_hz = RATE_HZ

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = ReplicaFolder.find(name)
        camera, units_per_m = folder.camera()
        super().__init__(f"replica:{name}", folder.pairs, camera, units_per_m, options)


def replica_truth(name: str, options: SourceOptions) -> Truth | None:
    """Poses and mesh; None without a file of poses. For the evaluator only."""
    folder = ReplicaFolder.find(name)
    path = folder.trajectory_file
    if not path.exists():
        return None
    poses, pairs = read_matrices(path), folder.pairs
    numbers = np.array([round(stamp_ns * RATE_HZ / 1e9) for stamp_ns, _, _ in pairs])
    if len(poses) == len(pairs):
        lines = np.arange(len(pairs))
    elif numbers.max() < len(poses):  # a part of the sequence: frame n has line n
        lines = numbers
    else:
        raise UserError(
            f"{path}: {len(poses)} poses: expected {len(pairs)}, one a frame, or one for each number up to "
            f"{numbers.max()}"
        )
    rows = list(options.selected(len(pairs)))
    stamps = np.array([pairs[i][0] for i in rows], np.int64)
    return Trajectory(stamps, poses[lines[rows]]), mesh_loader(folder.mesh_file)
