"""Sequences in TUM layout: folder, camera, and pairs of colour and depth images."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.trajectory import Trajectory, associate, by_stamp, format_stamp, read_tum
from hsslam_node.sources.download.tum_archive import TumArchive, data_folders
from hsslam_node.sources.files.camera_file import read_tum_camera
from hsslam_node.sources.files.image_pairs import ImagePairSource, report_left_out
from hsslam_node.sources.files.record_times import listed_stamp_ns
from hsslam_node.sources.files.truth_files import Truth
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import Reports
from hsslam_node.user_path import user_path

MAX_DT_NS = 20_000_000
_DEPTH_SCALE = 5000.0
# Published colour calibrations; depth is registered to colour. fr3 is distributed undistorted.
_FREIBURG_CAMERAS = {
    "1": Camera(
        640, 480, 517.306408, 516.469215, 318.643040, 255.313989,
        (0.262383, -0.953104, -0.005358, 0.002628, 1.163314),
    ),
    "2": Camera(
        640, 480, 520.908620, 521.007327, 325.141442, 249.701764,
        (0.231222, -0.784899, -0.003257, -0.000105, 0.917205),
    ),
    "3": Camera(640, 480, 535.4, 539.2, 320.1, 247.6),
}  # fmt: skip


@dataclass(frozen=True)
class TumFolder:
    """A folder in TUM layout: `rgb.txt`, `depth.txt` and the images that they list."""

    path: Path

    @classmethod
    def find(cls, name: str) -> "TumFolder":
        """The folder of a name such as `fr1/desk`, or of a path (absolute, here, or in
        $HSSLAM_DATA). A published sequence that is not on disk is fetched: `TumArchive.fetch`.

        Raises:
            UserError: not on disk, and the download fails.
        """
        archive = TumArchive.named(name)
        names = [name] if archive is None else [archive.folder_name, name]
        places = [folder / n for folder in data_folders() for n in names]
        for path in (user_path(name), *places):
            if path.is_dir():
                return cls(path)
        if archive is not None:
            return cls(archive.fetch())
        raise UserError(
            f"source tum:{name}: no such folder: expected one with rgb.txt and depth.txt"
        )

    def camera(self) -> tuple[Camera, float]:
        """Camera with its distortion, and depth units per metre.

        Raises:
            UserError: neither a `camera.json` nor a freiburg1/2/3 in the folder's name.
        """
        own = self.path / "camera.json"
        if own.exists():
            return read_tum_camera(own)
        freiburg = re.search(r"freiburg([123])", self.path.resolve().name)
        if freiburg is None:
            raise UserError(
                f"{own}: missing: expected width, height, fx, fy, cx, cy, distortion, depth_scale "
                "(only folders named freiburg1, 2 or 3 have a known camera)"
            )
        return _FREIBURG_CAMERAS[freiburg[1]], _DEPTH_SCALE

    @cached_property
    def pairs(self) -> list[tuple[int, Path, Path]]:
        """(stamp of the colour image in ns, colour file, depth file), in order of the stamps.

        Raises:
            UserError: a list is missing or malformed, or nothing can be associated.
        """
        (color_ns, color_files), (depth_ns, depth_files) = self._lists
        if color_ns[0] < 0:
            raise UserError(
                f"{self.path / 'rgb.txt'}: {format_stamp(int(color_ns[0]))}: expected times from 0 on"
            )
        pairs = associate(color_ns, depth_ns, MAX_DT_NS)
        if not pairs:
            raise UserError(f"{self.path}: no stamps of rgb.txt and depth.txt within 20 ms")
        return [(int(color_ns[i]), color_files[i], depth_files[j]) for i, j in pairs]

    def report_left_out(self, reports: Reports) -> None:
        """Report if many images are in no pair."""
        (_, color), (_, depth) = self._lists
        report_left_out(reports, self.path, self.pairs, color, depth)

    @cached_property
    def _lists(self) -> tuple[tuple[np.ndarray, list[Path]], ...]:
        """Stamps, ns, and files of `rgb.txt` and `depth.txt`, in order of the stamps."""
        return self._read_list("rgb.txt"), self._read_list("depth.txt")

    def listed_stamps(self, name: str) -> np.ndarray:
        """Stamps of a list such as `rgb.txt` in the order of its lines, [N] int64 ns.

        Raises:
            UserError: the list is missing or malformed.
        """
        return np.array(self._read_lines(name)[0], np.int64)

    def _read_list(self, name: str) -> tuple[np.ndarray, list[Path]]:
        stamps, files = self._read_lines(name)
        order = np.argsort(stamps, kind="stable")
        return np.array(stamps, np.int64)[order], [files[i] for i in order]

    def _read_lines(self, name: str) -> tuple[list[int], list[Path]]:
        path = self.path / name
        try:
            lines = path.read_text(encoding="utf-8-sig").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "cannot be read"
            raise UserError(f"{path}: {reason}: expected lines 'timestamp file'") from None
        stamps, files = [], []
        for number, line in enumerate(lines, 1):
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            word, *rest = line.split(maxsplit=1)
            file = rest[0].strip() if rest else ""
            stamp_ns = listed_stamp_ns(word)
            if stamp_ns is None or not file:
                raise UserError(f"{path}:{number}: {line.strip()!r}: expected 'timestamp file'")
            stamps.append(stamp_ns)
            files.append(self.path / file)
        if not stamps:
            raise UserError(f"{path}: holds no image: expected lines 'timestamp file'")
        return stamps, files


class TumSource(ImagePairSource):
    """A TUM sequence: colour and depth associated within 20 ms, both undistorted.

    Stamps are those of the colour images.

    Raises:
        UserError: the folder, its lists or its camera are missing or wrong.
    """

    def __init__(self, name: str, options: SourceOptions) -> None:
        folder = TumFolder.find(name)
        self.reports = Reports()
        folder.report_left_out(self.reports)
        super().__init__(f"tum:{name}", folder.pairs, *folder.camera(), options)


def tum_truth(name: str, options: SourceOptions) -> Truth | None:
    """Poses of `groundtruth.txt` within 20 ms of a frame; None without the file. For the evaluator only."""
    folder = TumFolder.find(name)
    path = folder.path / "groundtruth.txt"
    if not path.exists():
        return None
    truth = by_stamp(read_tum(path))
    rows = options.selected(len(folder.pairs))
    frames = np.array([stamp_ns for stamp_ns, _, _ in folder.pairs], np.int64)
    played = sorted(set(rows))  # repeated frames have one pose
    pairs = associate(frames[played], truth.stamps_ns, MAX_DT_NS)
    if not pairs:
        raise UserError(f"{path}: no pose within 20 ms of a frame of rgb.txt")
    truth_row = {played[i]: j for i, j in pairs}
    known = [row for row in rows if row in truth_row]
    return Trajectory(frames[known], truth.T_world_cam[[truth_row[row] for row in known]]), None


def tum_stamps(name: str) -> tuple[np.ndarray, np.ndarray]:
    """All stamps of `rgb.txt` and of `depth.txt` in the order of their lines, int64 ns."""
    folder = TumFolder.find(name)
    return folder.listed_stamps("rgb.txt"), folder.listed_stamps("depth.txt")
