"""From the text after `--source` to a source."""

import difflib

from hsslam_node.errors import UserError
from hsslam_node.sources.downscaled import Downscaled
from hsslam_node.sources.noise import KinectNoise
from hsslam_node.sources.replica import ReplicaSource
from hsslam_node.sources.source import Source, SourceOptions
from hsslam_node.sources.synth_room.synth_room import SynthRoom
from hsslam_node.sources.tum import TumSource

_EXAMPLES = (
    "synth:room",
    "tum:fr1/desk",
    "tum:fr2/xyz",
    "tum:fr3/office",
    "tum:<folder>",
    "replica:<folder>",
    "zenoh:",
)


def open_source(spec: str, options: SourceOptions | None = None) -> Source:
    """The source that `spec` names: `synth:room`, `tum:<name or folder>` or `replica:<folder>`.

    Raises:
        UserError: no such source, its files are not there, or its camera makes no sense.
    """
    options = options or SourceOptions()
    kind, colon, rest = spec.partition(":")
    if kind == "synth" and rest == "room":
        source: Source = SynthRoom(options)
    elif kind == "tum" and rest:
        source = TumSource(rest, options)
    elif kind == "replica" and rest:
        source = ReplicaSource(rest, options)
    elif kind == "zenoh" and colon and not rest:
        raise UserError("source zenoh: its frames come over the bus, there is nothing to open")
    else:
        raise unknown_source(spec)
    if options.noise == "kinect":
        source = KinectNoise(source, options.seed)
    return Downscaled(source, options.downscale) if options.downscale > 1 else source


def unknown_source(spec: str) -> UserError:
    """The error for a spec that names no source, with the nearest one that exists."""
    near = difflib.get_close_matches(spec, _EXAMPLES, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]}?" if near else ""
    return UserError(f"source {spec!r}: expected one of {', '.join(_EXAMPLES)}{hint}")
