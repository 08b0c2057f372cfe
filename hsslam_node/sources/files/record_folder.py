"""Which images of a plain folder belong together, and when they were taken."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import associate
from hsslam_node.sources.download.tum_archive import data_folders
from hsslam_node.sources.files.image_pairs import ImagePair, are_too_fast, report_left_out
from hsslam_node.sources.files.name_stamp import (
    name_number,
    name_stamp_ns,
    unpadded_stamps_ns,
)
from hsslam_node.sources.files.record_times import read_times
from hsslam_node.sources.options.source import RecordOptions
from hsslam_node.sources.reports import Report, Reports
from hsslam_node.user_path import user_path

_COLOR_FOLDERS = ("color", "rgb", "colour")
_COLOR_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
_DEPTH_SUFFIXES = (".png", ".tif", ".tiff")


@dataclass(frozen=True)
class RecordFolder:
    """A folder with `color/` (or `rgb/`) and `depth/`, and any file names in them."""

    path: Path
    options: RecordOptions

    @classmethod
    def find(cls, name: str, options: RecordOptions) -> "RecordFolder":
        """The folder of a path (absolute, here, or in $HSSLAM_DATA).

        Raises:
            UserError: not on disk.
        """
        for path in (user_path(name), *(folder / name for folder in data_folders())):
            if path.is_dir():
                return cls(path, options)
        raise UserError(
            f"source record:{name}: no such folder: expected one with color/ (or rgb/) and depth/"
        )

    @cached_property
    def pairs(self) -> list[ImagePair]:
        """(stamp of the colour image in ns, colour file, depth file), in order of the stamps.

        Stamps come from a list of times, else from the names, else from the rate. Depth is found by stamps
        in the names of both, else by numbers in the names, else by order if there are as many. Stamps that no
        camera can have are numbers behind the time of a session.

        Raises:
            UserError: there are no images, or no way to pair them.
        """
        color, (depth_of, _) = self._color, self._depth_of_color
        stamps = self._stamps(color)
        pairs = [(stamps[c], c, depth_of[c]) for c in color if c in depth_of and c in stamps]
        if not pairs:
            raise UserError(f"{self.path}: no colour image has a stamp and a depth image")
        return sorted(pairs)

    def report_pairs(self, reports: Reports) -> None:
        """Report if many images are left out, or if nothing but their order says which belong together."""
        report_left_out(reports, self.path, self.pairs, self._color, self._depth)
        if self._depth_of_color[1]:
            text = (
                f"{self.path}: colour and depth are paired by their order, as their names have no stamps and "
                "not the same numbers"
            )
            reports.add(Report("images paired by their order", text))

    @cached_property
    def _color(self) -> list[Path]:
        return self._images(_COLOR_FOLDERS, _COLOR_SUFFIXES, "colour")

    @cached_property
    def _depth(self) -> list[Path]:
        return self._images(("depth",), _DEPTH_SUFFIXES, "depth")

    def _images(self, names: tuple[str, ...], suffixes: tuple[str, ...], what: str) -> list[Path]:
        for name in names:
            folder = self.path / name
            if folder.is_dir():
                found = folder.iterdir()  # without hidden files, such as ._0.png of macOS
                files = [p for p in found if p.suffix.lower() in suffixes and p.name[0] != "."]
                if not files:
                    raise UserError(f"{folder}: no images: expected {', '.join(suffixes)}")
                return sorted(files, key=_natural)
        expected = " or ".join(f"{name}/" for name in names[:2])
        raise UserError(f"{self.path}: no images of {what}: expected them in {expected}")

    @cached_property
    def _depth_of_color(self) -> tuple[dict[Path, Path], bool]:
        """The depth file of each colour file that has one, and whether only their order tells it."""
        color, depth = self._color, self._depth
        color_ns, depth_ns = _name_stamps(color), _name_stamps(depth)
        if color_ns and depth_ns:
            by_color, by_depth = np.argsort(color_ns), np.argsort(depth_ns)
            sorted_ns = np.array(color_ns)[by_color], np.array(depth_ns)[by_depth]
            found = associate(*sorted_ns, max_dt_ns=round(1e6 * self.options.max_dt_ms))
            if not found:
                limit = f"--record.max-dt-ms {self.options.max_dt_ms:g}"
                raise UserError(
                    f"{self.path}: no stamps of colour and depth within {limit}: expected one clock"
                )
            return {color[by_color[i]]: depth[by_depth[j]] for i, j in found}, False
        color_number, depth_number = _all(name_number, color), _all(name_number, depth)
        if color_number and depth_number:
            numbered = dict(zip(depth_number, depth, strict=True))
            pairs = zip(color, color_number, strict=True)
            by_number = {file: numbered[n] for file, n in pairs if n in numbered}
            if 2 * len(by_number) >= min(len(color), len(depth)):
                return by_number, False
        if len(color) == len(depth):
            return dict(zip(color, depth, strict=True)), True
        raise UserError(
            f"{self.path}: {len(color)} colour and {len(depth)} depth images: expected as many, or "
            "the same numbers, or stamps, in their names"
        )

    def _stamps(self, color: list[Path]) -> dict[Path, int]:
        times = read_times(self.path, color)
        if times is not None:
            return times
        stamps = _name_stamps(color)
        if stamps is None:
            stamps = [round(i * 1e9 / self.options.rate_hz) for i in range(len(color))]
        return dict(zip(color, stamps, strict=True))


def _name_stamps(files: list[Path]) -> list[int] | None:
    """The stamps in all names, ns; None if one has none, or if they are closer than those of cameras."""
    stamps_ns = unpadded_stamps_ns([path.stem for path in files]) or _all(name_stamp_ns, files)
    return stamps_ns if stamps_ns and not are_too_fast(sorted(stamps_ns)) else None


def _all(of_name: Callable[[str], int | None], files: list[Path]) -> list[int] | None:
    """The values of all names; None if one has none, or two have the same."""
    found = [of_name(path.stem) for path in files]
    known = [value for value in found if value is not None]
    return known if len(set(known)) == len(files) else None


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sorts 2.png before 10.png."""
    return [(int(t), "") if t.isdigit() else (-1, t) for t in re.split(r"(\d+)", path.name) if t]
