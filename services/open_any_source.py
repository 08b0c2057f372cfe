"""From the text after `--source` to a source, those that need the wire or the log included."""

from collections.abc import Callable

from hsslam_node.services.live_source import is_live, open_live_source
from hsslam_node.sources.open_source import open_source, with_effects
from hsslam_node.sources.source import Source, SourceOptions


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
        from hsslam_node.services.log.mcap_source import McapSource

        return with_effects(McapSource(rest, options), options)
    if is_live(spec):
        return with_effects(open_live_source(spec, options, should_stop), options)
    return open_source(spec, options)
