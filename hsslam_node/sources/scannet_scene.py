"""A ScanNet scene as exported or as `.sens`: the same frames, cameras and poses from both."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.sources.scannet_folder import ScanNetFolder
from hsslam_node.sources.sens_file import SensFile

RATE_HZ = 30.0  # exported frames have no stamps: frame n is stamped n / 30 s, in both


@dataclass(frozen=True)
class ScanNetScene:
    """What a scene is read from: one of the two is set."""

    path: Path
    folder: ScanNetFolder | None = None
    sens: SensFile | None = None

    @classmethod
    def find(cls, name: str) -> "ScanNetScene":
        """The scene of a path (absolute, here, or in $HSSLAM_DATA): a folder, or a `.sens` file.

        Raises:
            UserError: not on disk, or a damaged file.
        """
        data = os.environ.get("HSSLAM_DATA")
        for path in (Path(name).expanduser(), *([Path(data) / name] if data else [])):
            if path.is_dir():
                return cls(path, folder=ScanNetFolder(path))
            if path.is_file():
                return cls(path, sens=SensFile.open(path))
        raise UserError(
            f"source scannet:{name}: no such folder or file here or in $HSSLAM_DATA: expected a .sens "
            "file, or a folder with color/, depth/, pose/ and intrinsic/"
        )

    def numbers(self) -> list[int]:
        """The number of every frame, which gives its stamp."""
        if self.sens is not None:
            return list(range(len(self.sens.frames)))
        assert self.folder is not None
        return [number for number, _, _ in self.folder.files]

    def stamps_ns(self) -> np.ndarray:
        """[N] int64."""
        return np.array([round(n * 1e9 / RATE_HZ) for n in self.numbers()], np.int64)

    def T_world_cam(self) -> np.ndarray:
        """[N, 4, 4]; not finite where the scene's authors could not tell. For the evaluator only."""
        if self.sens is not None:
            return self.sens.T_world_cam
        assert self.folder is not None
        return self.folder.poses()

    @property
    def mesh_file(self) -> Path | None:
        """The scene's mesh beside the frames: `*_vh_clean.ply`, or the coarser `*_vh_clean_2.ply`."""
        home = self.path if self.folder is not None else self.path.parent
        scene = re.sub(r"\.sens$", "", self.path.resolve().name)
        for ending in ("_vh_clean.ply", "_vh_clean_2.ply"):
            for place in (home / f"{scene}{ending}", home.parent / f"{scene}{ending}"):
                if place.exists():
                    return place
        return None
