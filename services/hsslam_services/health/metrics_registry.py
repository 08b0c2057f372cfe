"""A Prometheus registry of given metrics; apart as runs and batches of runs use it."""

from collections.abc import Iterator, Sequence

from prometheus_client.core import Metric
from prometheus_client.registry import CollectorRegistry


def registry_of(metrics: Sequence[Metric]) -> CollectorRegistry:
    """A registry of only these metrics, for an encoder of prometheus_client."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(metrics))
    return registry


class _Collector:
    """Hands the metrics to the registry."""

    def __init__(self, metrics: Sequence[Metric]) -> None:
        self._metrics = metrics

    def describe(self) -> list[Metric]:
        return []

    def collect(self) -> Iterator[Metric]:
        yield from self._metrics
