"""A ScanNet scene as exported or as `.sens`: the same frames, cameras and poses from both."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.sources.download.data_folder import possible_places
from hsslam_node.sources.files.name_stamp import numbered_stamp_ns
from hsslam_node.sources.files.sens_file import SensFile
from hsslam_node.sources.files.truth_files import read_matrix

DEPTH_UNITS_PER_M = 1000.0  # of exported depth images
_EXPECTED = "expected one with color/, depth/, pose/ and intrinsic/, or with one .sens file"


@dataclass(frozen=True)
class ScanNetFolder:
    """An exported scene.

    Raises:
        UserError: on use, if a file is missing or malformed.
    """

    path: Path

    @cached_property
    def files(self) -> list[tuple[int, Path, Path]]:
        """(number, colour file, depth file) of every frame with one of them; the other may be missing."""
        color, depth = self._numbered("color", "jpe?g|png"), self._numbered("depth", "png")
        numbers = sorted(color | depth)
        if not numbers:
            raise UserError(f"source scannet:{self.path}: no frames: {_EXPECTED}")
        return [
            (
                n,
                color.get(n, self.path / f"color/{n}.jpg"),
                depth.get(n, self.path / f"depth/{n}.png"),
            )
            for n in numbers
        ]

    def intrinsics(self) -> tuple[np.ndarray, np.ndarray]:
        """K of colour and of depth, [3, 3] each."""
        folder = self.path / "intrinsic"
        color, depth = (
            read_matrix(folder / f"intrinsic_{kind}.txt") for kind in ("color", "depth")
        )
        for name, K in (("color", color), ("depth", depth)):
            if not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0:
                raise UserError(f"{folder}/intrinsic_{name}.txt: expected a camera's 4x4 matrix")
        return color[:3, :3], depth[:3, :3]

    def poses(self) -> np.ndarray:
        """Camera to world of every frame, [N, 4, 4]; not finite if it is not known or missing."""
        unknown = np.full((4, 4), -np.inf)
        found = self._numbered("pose", "txt")
        return np.array(
            [read_matrix(found[n]) if n in found else unknown for n, _, _ in self.files]
        )

    def _numbered(self, kind: str, endings: str) -> dict[int, Path]:
        folder = self.path / kind
        found = {}
        for file in folder.iterdir() if folder.is_dir() else ():
            match = re.fullmatch(rf"(?:frame-)?(\d+)(?:\.{kind})?\.({endings})", file.name)
            if match:
                found[int(match[1])] = file
        return found


def _recording_in(folder: Path) -> Path | None:
    """The only `.sens` file of a folder without exported images; None for any other place."""
    found = [] if (folder / "color").exists() else list(folder.glob("*.sens"))
    return found[0] if len(found) == 1 else None


RATE_HZ = 30.0  # exported frames have no stamps: frame n is stamped n / 30 s, in both


@dataclass(frozen=True)
class ScanNetScene:
    """The files of a scene: one of the two is set."""

    path: Path
    folder: ScanNetFolder | None = None
    sens: SensFile | None = None

    @classmethod
    def find(cls, name: str) -> "ScanNetScene":
        """The scene of a path (absolute, here, or in $HSSLAM_DATA): a folder, a `.sens` file, or a folder as
        downloaded, which has one `.sens` file and no `color/`.

        Raises:
            UserError: not on disk, or a damaged file.
        """
        for place in possible_places(name):
            path = _recording_in(place) or place
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
        return np.array([numbered_stamp_ns(n, RATE_HZ) for n in self.numbers()], np.int64)

    def T_world_cam(self) -> np.ndarray:
        """[N, 4, 4]; not finite if the scene's authors do not know it. For the evaluator only."""
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
