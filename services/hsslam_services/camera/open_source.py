"""Opens the source of `--source`, including those that need the bus or a log."""

from collections.abc import Callable
from dataclasses import replace

from hsslam_node.errors import STORAGE_FAILS, UserError
from hsslam_node.frame import expect_trackable
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.source import Source
from hsslam_node.sources.source_row import find_row, imported, refuse_unread_options, source_name
from hsslam_node.user_path import user_path
from hsslam_proto.frame_codec import LARGEST_IMAGE_PX
from hsslam_proto.message import LARGEST_SIDE_PX
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.source_table import ALL_SOURCES, refuse_rate


def open_any_source(
    spec: str,
    options: SourceOptions | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Source:
    """As `open_source`, with the sources of the service as well: logs and ROS 2 cameras.

    Raises:
        UserError: unknown source, missing files, an invalid camera, or images that are too large for a
            message or too small to track, or the disk fails.
    """
    try:
        source = open_source(spec, options, should_stop, ALL_SOURCES)
    except OSError as error:
        if error.errno not in STORAGE_FAILS:
            raise
        where = error.filename or f"source {spec}"
        raise UserError(f"{where}: {error.strerror}: expected a file that can be read") from None
    width_px, height_px = source.camera.width_px, source.camera.height_px
    images = f"source {source.name}: images of {width_px}x{height_px} pixels"
    if max(width_px, height_px) > LARGEST_SIDE_PX or width_px * height_px > LARGEST_IMAGE_PX:
        raise UserError(
            f"{images}: expected at most {LARGEST_SIDE_PX} a side and {1e-6 * LARGEST_IMAGE_PX:.1f} million"
        )
    expect_trackable(source.camera, f"source {source.name}: ")
    return source


def check_source_exists(options: ServeOptions) -> None:
    """Check that the source opens; downloads a published sequence that is not on disk.

    Of a recording that is read to be counted, it checks the first selected frame.

    Does not open a live camera: only one process can have it, and it may need the router of this run.

    Raises:
        UserError: unknown source, missing or invalid files or camera, or `--rate-hz` does not apply to it.
    """
    if options.rate_hz is not None:
        refuse_rate(options.source, options.rate_hz)
    row = find_row(options.source, ALL_SOURCES)
    if row is not None and row.is_live:
        refuse_unread_options(row, options.source, options.source_options)
        if row.check is not None:
            imported(row.check)(source_name(options.source), options.source_options)
        mask = options.source_options.mask
        if mask and not user_path(mask).is_file():
            raise UserError(f"--mask {mask}: no such file: expected an image of the camera's size")
    elif options.has_camera_process:
        checked = replace(options.source_options, noise="none")
        if row is not None and row.reads_to_count:
            checked = replace(checked, frames=1)
        source = open_any_source(options.source, checked)
        if source.frame_count == 0 and options.start:
            raise UserError(f"--start {options.start}: source {options.source} has fewer frames")
        if source.frame_count == 0:
            raise UserError(f"source {options.source} has no frames")
