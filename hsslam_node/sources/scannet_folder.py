"""Where the files of an exported ScanNet scene lie: color/0.jpg, depth/0.png, pose/0.txt, intrinsic/*.txt."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError

DEPTH_UNITS_PER_M = 1000.0  # of exported depth images
_EXPECTED = "expected one with color/, depth/, pose/ and intrinsic/"


@dataclass(frozen=True)
class ScanNetFolder:
    """An exported scene.

    Raises:
        UserError: on use, where a file is missing or malformed.
    """

    path: Path

    @cached_property
    def files(self) -> list[tuple[int, Path, Path]]:
        """(number, colour file, depth file) of every frame of which there is one; the other may lack."""
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
        color, depth = (_matrix(folder / f"intrinsic_{kind}.txt") for kind in ("color", "depth"))
        for name, K in (("color", color), ("depth", depth)):
            if not np.isfinite(K).all() or K[0, 0] <= 0 or K[1, 1] <= 0:
                raise UserError(f"{folder}/intrinsic_{name}.txt: expected a camera's 4x4 matrix")
        return color[:3, :3], depth[:3, :3]

    def poses(self) -> np.ndarray:
        """Camera to world of every frame, [N, 4, 4]; not finite where it is not known or not there."""
        unknown = np.full((4, 4), -np.inf)
        paths = [self.path / f"pose/{n}.txt" for n, _, _ in self.files]
        return np.array([_matrix(path) if path.exists() else unknown for path in paths])

    def _numbered(self, kind: str, endings: str) -> dict[int, Path]:
        folder = self.path / kind
        found = {}
        for file in folder.iterdir() if folder.is_dir() else ():
            match = re.fullmatch(rf"(?:frame-)?(\d+)(?:\.{kind})?\.({endings})", file.name)
            if match:
                found[int(match[1])] = file
        return found


def _matrix(path: Path) -> np.ndarray:
    try:
        matrix = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        text = " ".join(str(error).split())
        raise UserError(f"{path}: {text}: expected four lines of four numbers") from None
    if matrix.shape != (4, 4):
        shape = "x".join(map(str, matrix.shape))
        raise UserError(f"{path}: {shape} numbers: expected four lines of four")
    return matrix
