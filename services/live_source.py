"""Cameras that deliver when they deliver, as opposed to recordings."""

from collections.abc import Callable

from hsslam_node.sources.open_source import unknown_source
from hsslam_node.sources.source import Source, SourceOptions


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
        from hsslam_node.services.ros2.ros2_source import Ros2Source

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
        from hsslam_node.services.ros2.cdr_messages import CdrMessages

        options.ros2.topics_under(name)
        CdrMessages()
    elif spec == "realsense":
        from hsslam_node.sources.realsense import expect_realsense

        expect_realsense(options.realsense.serial)
    else:
        raise unknown_source(spec)
