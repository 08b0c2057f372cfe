"""Where the files of a sequence in Replica layout lie."""

import os
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from hsslam_node.errors import UserError

RATE_HZ = 30.0  # the layout has no stamps


@dataclass(frozen=True)
class ReplicaFolder:
    """A folder with `cam_params.json`, `results/frame*.jpg`, `results/depth*.png`, `traj.txt`."""

    path: Path

    @classmethod
    def find(cls, name: str) -> "ReplicaFolder":
        """The folder of a path (absolute, here, or in $HSSLAM_DATA).

        Raises:
            UserError: not on disk.
        """
        data = os.environ.get("HSSLAM_DATA")
        candidates = [Path(name).expanduser(), *([Path(data) / name] if data else [])]
        for path in candidates:
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

    @property
    def mesh_file(self) -> Path | None:
        """The mesh of the scene: `mesh.ply`, or `<scene>_mesh.ply` beside the folder."""
        scene = self.path.resolve().name
        for path in (self.path / "mesh.ply", self.path.parent / f"{scene}_mesh.ply"):
            if path.exists():
                return path
        return None

    @cached_property
    def pairs(self) -> list[tuple[int, Path, Path]]:
        """(stamp in ns, colour file, depth file) of every frame number; a file may be missing.

        Raises:
            UserError: `results/` holds no frame.
        """
        results = self.path / "results"
        found: dict[int, dict[str, Path]] = {}
        for file in results.iterdir() if results.is_dir() else ():
            match = re.fullmatch(r"(frame|depth)(\d+)\.(jpg|jpeg|png)", file.name)
            if match:
                found.setdefault(int(match[2]), {})[match[1]] = file
        if not found:
            raise UserError(f"{results}: no frames: expected frame000000.jpg and depth000000.png")
        return [
            (
                round(number * 1e9 / RATE_HZ),
                files.get("frame", results / f"frame{number:06d}.jpg"),
                files.get("depth", results / f"depth{number:06d}.png"),
            )
            for number, files in sorted(found.items())
        ]
