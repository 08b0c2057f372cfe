"""Opens the source that `--source` names."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hsslam_node.errors import UserError, one_line
from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source import ReadsInTime, Source
from hsslam_node.sources.source_row import (
    SourceRow,
    find_row,
    guess_source,
    imported,
    refuse_unread_options,
    source_name,
    unknown_source,
)
from hsslam_node.user_path import user_path


def open_source(
    spec: str,
    options: SourceOptions | None = None,
    should_stop: Callable[[], bool] = lambda: False,
    rows: Sequence[SourceRow] = SOURCES,
) -> Source:
    """The source that `spec` names, of one of the `rows`: `synth:room`, `tum:FOLDER`, `realsense`, ...

    The frames of a live camera end when `should_stop()`.

    Raises:
        UserError: no such source, its files are missing, or its camera is invalid.
    """
    options = options or SourceOptions()
    try:
        source = _plain_source(spec, options, should_stop, rows)
    except UserError as error:
        guess = guess_source(source_name(spec), rows)
        if guess in ("", spec):
            raise
        raise UserError(f"{error}; did you mean {guess}?") from None
    has_masks = bool(options.mask) and user_path(options.mask).is_dir()
    if has_masks and not (isinstance(source, ReadsInTime) and source.reads_masks):
        raise UserError(
            f"--mask {options.mask}: source {spec} has no image files: expected one mask, not a folder"
        )
    return _with_effects(source, replace(options, mask="") if has_masks else options)


def _plain_source(
    spec: str, options: SourceOptions, should_stop: Callable[[], bool], rows: Sequence[SourceRow]
) -> Source:
    """Imports only what this source needs: the supervisor also opens it, to check it."""
    row = find_row(spec, rows)
    if row is None:
        raise unknown_source(spec, rows)
    if row.opener is None:
        raise UserError(f"source {spec}: its frames come over the bus, there is nothing to open")
    refuse_unread_options(row, spec, options)
    if row.fault:
        raise UserError(f"source {spec}: package {row.package} does not work: {row.fault}")
    try:
        opener = imported(row.opener)
        further = (should_stop,) if row.is_live else ()
        source = opener(source_name(spec), options, *further)
        if row.package:
            _expect_attributes(source)
        return source
    except UserError:
        raise
    except (Exception, SystemExit) as error:
        if not row.package:
            raise
        raise UserError(
            f"source {spec}: package {row.package} does not work: {one_line(error)}"
        ) from error


def _expect_attributes(source: Source) -> None:
    """Check what a plugin's source says of itself.

    Raises:
        TypeError, AttributeError: an attribute has another type than in `Source`, or is missing.
    """
    expected = {
        "name": (str, "a text"),
        "camera": (Camera, "a Camera"),
        "frame_count": (int | np.integer | None, "a whole number or None"),
    }
    for name, (kind, what) in expected.items():
        if not isinstance(value := getattr(source, name), kind):
            raise TypeError(f"{name} = {value!r}: expected {what}")
    for name in ("rate_hz", "depth_units_per_m"):
        value = getattr(source, name)
        if not (isinstance(value, int | float | np.number) and 0 < value < math.inf):
            raise TypeError(f"{name} = {value!r}: expected a number above 0")


def _with_effects(source: Source, options: SourceOptions) -> Source:
    """The source with the stamps, noise, exposure, mask, cover and size that the options ask for."""
    if options.reorders:
        from hsslam_node.sources.effects.restamped import Restamped

        source = Restamped(source)
    if options.noise == "kinect":
        from hsslam_node.sources.effects.kinect_noise import KinectNoise

        source = KinectNoise(source, options.seed)
    if options.exposure == "drift":
        from hsslam_node.sources.effects.changing_exposure import ChangingExposure

        source = ChangingExposure(source, options.seed)
    if options.mask:
        from hsslam_node.sources.effects.hidden import Masked

        source = Masked(source, options.mask)
    if options.cover_frames:
        from hsslam_node.sources.effects.hidden import Covered

        source = Covered(source, options.cover_at, options.cover_frames)
    if options.downscale > 1:
        from hsslam_node.sources.effects.downscaled import Downscaled

        source = Downscaled(source, options.downscale)
    return source
