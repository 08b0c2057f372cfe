"""From the text after `--source` to a source, those that need the wire or the log included.

Cameras that deliver when they deliver, as opposed to recordings.

Whether the source of a run is there, asked before anything is started.
"""

from collections.abc import Callable
from dataclasses import replace

from hsslam_node.errors import UserError
from hsslam_node.sources.open_source import open_source, unknown_source, with_effects
from hsslam_node.sources.options import SourceOptions
from hsslam_node.sources.source import Source
from hsslam_services.run.options import ServeOptions


def is_live(spec: str) -> bool:
    """Whether frames come on the camera's own clock, and those that are not taken are gone."""
    return spec.partition(":")[0] in ("ros2", "realsense")


def open_live_source(
    spec: str, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
) -> Source:
    """The camera that `spec` names, `ros2:<namespace>` or `realsense`; its frames end when `should_stop`.

    Raises:
        UserError: no such camera, a package is missing, or no image comes.
    """
    kind, _, name = spec.partition(":")
    if kind == "ros2":
        from hsslam_services.camera.ros2_source import Ros2Source

        return Ros2Source(name, options, should_stop)
    if spec == "realsense":
        from hsslam_node.sources.realsense import RealsenseSource

        return RealsenseSource(options, should_stop)
    raise unknown_source(spec)


def expect_live_source(spec: str, options: SourceOptions) -> None:
    """What can be told of a camera without opening it: names, packages, whether it is plugged in.

    Raises:
        UserError: as `open_live_source`.
    """
    kind, _, name = spec.partition(":")
    if kind == "ros2":
        from hsslam_services.camera.ros2_messages import CdrMessages

        options.ros2.topics_under(name)
        CdrMessages()
    elif spec == "realsense":
        from hsslam_node.sources.realsense import expect_realsense

        expect_realsense(options.realsense.serial)
    else:
        raise unknown_source(spec)


def open_any_source(
    spec: str,
    options: SourceOptions | None = None,
    should_stop: Callable[[], bool] = lambda: False,
) -> Source:
    """As `open_source`, which knows neither logs nor messages; besides `mcap:<file or run folder>` and live
    cameras, whose frames end when `should_stop`.

    Raises:
        UserError: no such source, its files are not there, or its camera makes no sense.
    """
    options = options or SourceOptions()
    kind, _, rest = spec.partition(":")
    if kind == "mcap" and rest:
        from hsslam_services.log.source import McapSource

        return with_effects(McapSource(rest, options), options)
    if is_live(spec):
        return with_effects(open_live_source(spec, options, should_stop), options)
    return open_source(spec, options)


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
