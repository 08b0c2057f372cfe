"""Table of all sources: those of the library, of the bus and logs, and plugins; one row for each kind."""

from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.registry import SOURCES
from hsslam_node.sources.source_row import (
    SourceRow,
    either,
    find_row,
    has_files,
    has_suffix,
    refuse_unread_options,
    source_name,
)
from hsslam_services.run.source_plugins import plugin_rows

_LOG = SourceRow(
    kind="mcap",
    examples=("mcap:RUN", "mcap:FILE"),
    brief="the frames of a log",
    about="the frames of a [log](logs.md#replay-a-log)",
    opener="hsslam_services.log.reading.source:McapSource",
    camera_options=(),
    looks_like=either(has_files("run*.mcap"), has_suffix(".mcap")),
    only_forwards=True,
    stamps="hsslam_services.log.reading.source:log_stamps",
)
SERVICE_SOURCES = (
    SourceRow(  # before logs: a bag may have MCAP files of any name
        kind="bag",
        examples=("bag:FOLDER", "bag:FILE"),
        brief="a ROS 1 or ROS 2 bag",
        about="[a ROS bag](#ros-bags): of ROS 2 (`metadata.yaml`, `.mcap`, `.db3`) or ROS 1 (`.bag`)",
        opener="hsslam_services.camera.bags.bag_source:BagSource",
        camera_options=("depth_scale",),
        looks_like=either(
            has_files("metadata.yaml", "*.mcap*"),
            has_files("metadata.yaml", "*.db3*"),
            has_suffix(".bag"),
            has_suffix(".db3"),
        ),
        only_forwards=True,
        reads_to_count=True,
    ),
    _LOG,
    SourceRow(
        kind="ros2",
        examples=("ros2:/camera",),
        brief="a ROS 2 camera, over rmw_zenoh",
        about="[a camera in ROS 2](#ros-2-cameras) over rmw_zenoh",
        opener="hsslam_services.camera.ros2_source:Ros2Source",
        camera_options=("depth_scale",),
        is_live=True,
        needs_port=True,
        check="hsslam_services.camera.ros2_messages:check_ros2",
    ),
    SourceRow(
        kind="zenoh",
        examples=("zenoh:",),
        brief="frames that another program publishes",
        about="[frames that another program publishes](#a-camera-driver-of-your-own)",
        opener=None,
        camera_options=(),
        only_examples=True,
        needs_port=True,
    ),
)
_OF_FRAMES = (  # options that select or change the frames of a source
    *("noise", "exposure", "start", "stride", "frames", "to_and_fro", "hold_at", "hold_frames"),
    *("cover_at", "cover_frames", "mask", "downscale"),
)
_EXAMPLES_WIDTH = 40  # characters of a line of `--help`
OWN_SOURCES: tuple[SourceRow, ...] = (*SOURCES, *SERVICE_SOURCES)
ALL_SOURCES: tuple[SourceRow, ...] = (*OWN_SOURCES, *plugin_rows(OWN_SOURCES))


def sources_help() -> str:
    """The table as lines of `--help`."""
    lines = ["Sources:"]
    for row in ALL_SOURCES:
        examples = ", ".join(row.examples)
        own_line = len(examples) >= _EXAMPLES_WIDTH
        lines += [f"  {examples}"] if own_line else []
        lines.append(f"  {'' if own_line else examples:<{_EXAMPLES_WIDTH}}{row.brief}")
    return "\n".join(lines)


def is_live(spec: str) -> bool:
    """Whether the source is a live camera: a frame that is not taken in time is lost."""
    row = find_row(spec, ALL_SOURCES)
    return row is not None and row.is_live


def comes_over_bus(spec: str) -> bool:
    """Whether another program publishes the frames, so that there is no camera process."""
    row = find_row(spec, ALL_SOURCES)
    return row is not None and row.opener is None


def comes_once(spec: str) -> bool:
    """Whether frames cannot be read again: they come from a live camera or another program."""
    return is_live(spec) or comes_over_bus(spec)


def refuse_ignored_options(spec: str, options: SourceOptions) -> None:
    """Raise UserError if an option is set that changes frames, but another program publishes them."""
    if row := find_row(spec, ALL_SOURCES):
        refuse_unread_options(row, spec, options)
    untouched = SourceOptions()
    for name in _OF_FRAMES:
        if (value := getattr(options, name)) != getattr(untouched, name):
            what = "set their depth to 0" if name == "mask" else "choose or change them"
            raise UserError(
                f"--{name.replace('_', '-')} {value}: another program sends the frames (--source {spec}): "
                f"{what} in that program"
            )


def refuse_rate(spec: str, rate_hz: float) -> None:
    """Raise UserError if a run cannot set the rate of this source."""
    if comes_once(spec):
        remedy = (
            "expected the rate in that program" if comes_over_bus(spec) else "expected --stride"
        )
        remedy += " or --realsense.rate-hz" if spec == "realsense" else ""
        raise UserError(f"--rate-hz {rate_hz:g}: source {spec} has a clock of its own: {remedy}")


def needs_port(spec: str) -> bool:
    """Whether programs outside the run send the frames: another driver, or ROS nodes."""
    row = find_row(spec, ALL_SOURCES)
    return row is not None and row.needs_port


def speaks_ros2(spec: str) -> bool:
    """Whether frames carry stamps of ROS."""
    row = find_row(spec, ALL_SOURCES)
    return row is not None and row.kind == "ros2"


def log_place(spec: str) -> str:
    """The file or run folder of a log source `mcap:PLACE`; empty for any other source."""
    return source_name(spec) if _LOG.matches(spec) else ""
