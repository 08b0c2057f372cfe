"""Whether the source of a run is there, asked before anything is started."""

from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.services.live_source import expect_live_source, is_live
from hsslam_node.services.open_any_source import open_any_source
from hsslam_node.services.options import ServeOptions


def expect_source(options: ServeOptions) -> None:
    """Open the source and leave it; a published sequence that is not on disk is fetched.

    A live camera is left to the camera process: only one can have it, and it may need our router.

    Raises:
        UserError: no such source, or its files or camera are missing or wrong.
    """
    if is_live(options.source):
        expect_live_source(options.source, options.source_options)
    elif options.has_camera_process:
        source = open_any_source(options.source, replace(options.source_options, noise="none"))
        if source.frame_count == 0:
            raise UserError(f"--start {options.start}: source {options.source} has no more frames")
