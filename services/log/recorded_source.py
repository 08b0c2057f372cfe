"""What a log was recorded from: for those who look for its ground truth."""

from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from hsslam_node.errors import UserError
from hsslam_node.services.log.log_file import Say, log_parts
from hsslam_node.services.log.log_reader import log_reader
from hsslam_node.services.log.mcap_source import McapSource
from hsslam_node.services.mcap_log import RUN_METADATA
from hsslam_node.services.options import ServeOptions
from hsslam_node.sources.source import SourceOptions

_MOST_LOGS = 8  # a run from the log of a run from the log of ...


@dataclass(frozen=True)
class RecordedSource:
    """A source as `open_source` takes it."""

    spec: str
    options: SourceOptions


def recorded_source(spec: str, options: SourceOptions, say: Say) -> RecordedSource:
    """`spec` itself, unless it is a log: then what its frames came from, with the same selection of them.

    Raises:
        UserError: a log is not there, cannot be read or does not tell.
    """
    for _ in range(_MOST_LOGS):
        kind, _, place = spec.partition(":")
        if kind != "mcap":
            return RecordedSource(spec, options)
        run = logged_options(log_parts(place, say))
        if run is None:
            raise UserError(f"source {spec}: does not tell what it was recorded from")
        count = McapSource(place, options).frame_count
        inner = run.source_options
        spec = run.source
        options = replace(
            inner,
            noise=options.noise if inner.noise == "none" else inner.noise,
            start=inner.start + inner.stride * options.start,
            stride=inner.stride * options.stride,
            frames=count,
            downscale=inner.downscale * options.downscale,
        )
    raise UserError(
        f"source {spec}: expected at most {_MOST_LOGS} logs, each recorded from the next"
    )


def logged_options(files: list[Path]) -> ServeOptions | None:
    """The options of the run that wrote the log; None where it does not tell, or is of another version.

    Raises:
        UserError: the log is damaged.
    """
    with log_reader(files[0]) as reader:
        records = list(reader.iter_metadata())
    about = next((record.metadata for record in records if record.name == RUN_METADATA), {})
    try:
        return msgspec.json.decode(about.get("options", "").encode(), type=ServeOptions)
    except (msgspec.MsgspecError, UserError):
        return None
