"""Cameras that deliver when they deliver, as opposed to recordings."""

from collections.abc import Callable

from hsslam_node.errors import UserError
from hsslam_node.sources.source import Source, SourceOptions


def is_live(spec: str) -> bool:
    """Whether frames come on the camera's own clock, and those that are not taken are gone."""
    return spec.partition(":")[0] in ("ros2",)


def open_live_source(
    spec: str, options: SourceOptions, should_stop: Callable[[], bool] = lambda: False
) -> Source:
    """The camera that `spec` names, `ros2:<namespace>`; its frames end when `should_stop`.

    Raises:
        UserError: no such camera, a package is missing, or no image comes.
    """
    kind, _, name = spec.partition(":")
    if kind == "ros2":
        from hsslam_node.services.ros2.ros2_source import Ros2Source

        return Ros2Source(name, options, should_stop)
    raise UserError(f"source {spec}: no live camera")


def expect_live_source(spec: str, options: SourceOptions) -> None:
    """What can be told of a camera without opening it: names and packages.

    Raises:
        UserError: as `open_live_source`.
    """
    from hsslam_node.services.ros2.cdr_messages import CdrMessages

    options.ros2.topics_under(spec.partition(":")[2])
    CdrMessages()
