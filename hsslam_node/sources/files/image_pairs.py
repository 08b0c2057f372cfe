"""Pairs of image files as a source: what TUM, Replica and plain folders have in common."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.files.frame_masks import FrameMasks
from hsslam_node.sources.files.image_files import (
    BadImageError,
    DiskFailures,
    UnreadImageError,
    read_any_color,
    read_any_depth,
    read_color,
    read_depth,
)
from hsslam_node.sources.files.undistortion import Undistortion
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.reports import USUAL_SHARE, Report, Reports
from hsslam_node.sources.source import BadFrame, IsLate, LateFrame, ReadsInTime, UnreadFrame

ImagePair = tuple[int, Path, Path]  # stamp in ns, colour file, depth file

_SHORTEST_PERIOD_NS = 1e6  # between two frames
_MOST_BROKEN = 30  # pairs before the first that can be used


class ImagePairSource(ReadsInTime):
    """Files of colour and of the depth registered to it, both undistorted.

    `camera`: of the files, with its distortion. `pairs`: in order of their stamps. `masks`: folder of masks,
    if it exists and `--mask` names no other.
    """

    reads_masks = True
    numbered_hz: float | None = None
    """Frame n is stamped n / `numbered_hz`, as the layout has no stamps; None: it has some."""

    def __init__(
        self,
        name: str,
        pairs: Sequence[ImagePair],
        camera: Camera,
        depth_units_per_m: float,
        options: SourceOptions,
        masks: Path | None = None,
    ) -> None:
        self._pairs = [pairs[i] for i in options.selected(len(pairs))]
        color_files = [color_file for _, color_file, _ in self._pairs]
        self._masks = FrameMasks.found(options.mask, masks, color_files)
        self._undistortion = Undistortion(camera)
        self.name = name
        self.camera = camera.undistorted()
        self.depth_units_per_m = depth_units_per_m
        self.frame_count: int | None = len(self._pairs)
        stamps_ns = [pairs[i][0] for i in options.recorded(len(pairs))]
        by_number = self.numbered_hz
        self.rate_hz = (
            numbered_rate_hz(stamps_ns, by_number) if by_number else median_rate_hz(stamps_ns)
        )

    def frames_in_time(self, first: int, is_late: IsLate) -> Iterator[Frame | BadFrame]:
        """Every pair of images; an unreadable one is a `BadFrame`, a late one a `LateFrame`."""
        for index in range(first, len(self._pairs)):
            stamp_ns, color_file, depth_file = self._pairs[index]
            if is_late(index, stamp_ns):
                yield LateFrame(index, stamp_ns)
                continue
            try:
                color = read_color(color_file, self.camera)
                depth = read_depth(depth_file, self.camera)
                if self._masks is not None:
                    hidden = self._masks.hidden(color_file, self.camera)
                    depth = np.where(hidden, np.uint16(0), depth)
            except BadImageError as error:
                yield without_image(index, stamp_ns, error)
                continue
            yield Frame(
                index=index,
                stamp_ns=stamp_ns,
                camera=self.camera,
                color=self._undistortion.color(color),
                depth_raw=self._undistortion.depth(depth),
                depth_units_per_m=self.depth_units_per_m,
            )


def without_image(index: int, stamp_ns: int, error: BadImageError) -> BadFrame:
    """A frame whose image cannot be read."""
    kind = UnreadFrame if isinstance(error, UnreadImageError) else BadFrame
    return kind(index, stamp_ns, str(error))


def median_rate_hz(stamps_ns: Sequence[int] | np.ndarray) -> float:
    """The rate of stamps at their median interval; 30 Hz if there is none, or if no camera is as fast."""
    has_rate = len(stamps_ns) > 1 and not are_too_fast(stamps_ns)
    return 1e9 / _median_period_ns(stamps_ns) if has_rate else 30.0


def are_too_fast(stamps_ns: Sequence[int] | np.ndarray) -> bool:
    """Whether stamps are closer to each other, in the median, than those of any camera."""
    return len(stamps_ns) > 1 and _median_period_ns(stamps_ns) <= _SHORTEST_PERIOD_NS


def _median_period_ns(stamps_ns: Sequence[int] | np.ndarray) -> float:
    return float(np.median(np.abs(np.diff(stamps_ns))))


def numbered_rate_hz(stamps_ns: Sequence[int] | np.ndarray, numbered_hz: float) -> float:
    """The rate of frames n stamped n / `numbered_hz`, rounded to ns: that at the median step of n."""
    steps = np.diff(np.round(np.array(stamps_ns) * numbered_hz / 1e9))
    return numbered_hz / float(np.median(steps)) if len(steps) else numbered_hz


def first_size_px(source: str, pairs: Sequence[ImagePair]) -> tuple[int, int]:
    """Width and height of the first pair that can be used.

    Raises:
        UserError: none of the first 30 can; the fault of the first pair. Or the disk fails twice.
    """
    problem: UserError | None = None
    failures = DiskFailures()
    for _, color_file, depth_file in pairs[:_MOST_BROKEN]:
        try:
            height, width = read_any_color(color_file).shape[:2]
            depth_height, depth_width = read_any_depth(depth_file).shape
        except BadImageError as error:
            failures.take(error)
            problem = problem or UserError(f"source {source}: first frame: {error}")
            continue
        if (depth_width, depth_height) == (width, height):
            return width, height
        problem = problem or UserError(
            f"{depth_file}: {depth_width}x{depth_height} pixels, colour has {width}x{height}: "
            "expected depth registered to colour (most cameras' software can: 'align to colour')"
        )
    assert problem is not None, "a folder has one pair at least"
    raise problem


def report_left_out(
    reports: Reports,
    folder: Path,
    pairs: Sequence[ImagePair],
    color: Sequence[Path],
    depth: Sequence[Path],
) -> None:
    """Report if many images of a folder are in no pair, all along or at the end; `color` and `depth`: all
    files, in their order."""
    if len(pairs) < USUAL_SHARE * min(len(color), len(depth)):
        text = (
            f"{folder}: only {len(pairs)} of {len(color)} colour images have a time and one of {len(depth)} "
            "depth images; the others are left out"
        )
        reports.add(Report("images without a counterpart", text))
        return
    paired = {file for _, *files in pairs for file in files}
    for name, other, files in (("colour", "depth", color), ("depth", "colour", depth)):
        last = max(k for k, file in enumerate(files) if file in paired)
        alone = len(files) - 1 - last
        if alone > (1 - USUAL_SHARE) * len(files):
            text = (
                f"{folder}: the last {alone} of {len(files)} {name} images are left out: images of {other} "
                "end earlier"
            )
            reports.add(Report(f"{other} ends earlier", text))
