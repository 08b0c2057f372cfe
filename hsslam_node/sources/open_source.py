"""From the text after `--source` to a source."""

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.sources.guess_source import guess_source
from hsslam_node.sources.options import SourceOptions
from hsslam_node.sources.source import Source

_EXAMPLES = (
    "synth:room",
    "synth:apartment",
    "synth:corridor",
    "synth:person",
    "tum:fr1/desk",
    "tum:fr2/xyz",
    "tum:fr3/office",
    "tum:<folder>",
    "replica:<folder>",
    "scannet:<folder or .sens>",
    "record:<folder>",
    "mcap:<log>",
    "ros2:/camera",
    "realsense",
    "zenoh:",
)


def source_examples() -> tuple[str, ...]:
    """The sources that need no path: synth:room, tum:fr1/desk, ros2:/camera, ..."""
    return tuple(example for example in _EXAMPLES if "<" not in example)


def open_source(spec: str, options: SourceOptions | None = None) -> Source:
    """The source that `spec` names: `synth:<scene>`, `tum:<name or folder>`, `replica:<folder>`,
    `scannet:<folder or .sens>` or `record:<folder>`.

    Raises:
        UserError: no such source, its files are not there, or its camera makes no sense.
    """
    options = options or SourceOptions()
    try:
        source = _plain_source(spec, options)
    except UserError as error:
        guess = guess_source(spec.partition(":")[2])
        if guess in ("", spec):
            raise
        raise UserError(f"{error}; did you mean {guess}?") from None
    return with_effects(source, options)


def with_effects(source: Source, options: SourceOptions) -> Source:
    """The source with the noise, the changes of exposure and the size that the options ask for."""
    if options.noise == "kinect":
        from hsslam_node.sources.effects import KinectNoise

        source = KinectNoise(source, options.seed)
    if options.exposure == "drift":
        from hsslam_node.sources.effects import ChangingExposure

        source = ChangingExposure(source, options.seed)
    if options.downscale > 1:
        from hsslam_node.sources.effects import Downscaled

        source = Downscaled(source, options.downscale)
    return source


def _plain_source(spec: str, options: SourceOptions) -> Source:
    """Imports what this one source needs: the supervisor opens it, too, to see that it is there."""
    kind, colon, rest = spec.partition(":")
    if kind == "synth" and spec in _EXAMPLES:
        from hsslam_node.sources.synth import SynthSource

        return SynthSource(rest, options)
    if kind == "tum" and rest:
        from hsslam_node.sources.tum import TumSource

        return TumSource(rest, options)
    if kind == "replica" and rest:
        from hsslam_node.sources.replica import ReplicaSource

        return ReplicaSource(rest, options)
    if kind == "scannet" and rest:
        from hsslam_node.sources.scannet import ScanNetSource

        return ScanNetSource(rest, options)
    if kind == "record" and rest:
        from hsslam_node.sources.record import RecordSource

        return RecordSource(rest, options)
    if kind == "mcap" and rest:
        raise UserError(
            f"source {spec}: a log has no ground truth and is opened by the service only"
        )
    if (kind == "ros2" and rest) or spec == "realsense":
        raise UserError(f"source {spec}: a live camera is opened by the service only")
    if kind == "zenoh" and colon and not rest:
        raise UserError("source zenoh: its frames come over the bus, there is nothing to open")
    raise unknown_source(spec)


def unknown_source(spec: str) -> UserError:
    """The error for a spec that names no source, with the nearest one that exists."""
    found = guess_source(spec)
    hint = f"; did you mean {found}?" if found else did_you_mean(spec, _EXAMPLES, cutoff=0.4)
    return UserError(f"source {spec!r}: expected one of {', '.join(_EXAMPLES)}{hint}")
