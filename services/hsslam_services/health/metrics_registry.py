"""Metrics as a registry of Prometheus; alone, as a run and a batch of runs write theirs with it."""

from collections.abc import Iterator, Sequence

from prometheus_client.core import Metric
from prometheus_client.registry import CollectorRegistry


def registry_of(metrics: Sequence[Metric]) -> CollectorRegistry:
    """A registry of these metrics alone, for an encoder of prometheus_client."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_Collector(metrics))
    return registry


class _Collector:
    """What the registry asks when it is asked."""

    def __init__(self, metrics: Sequence[Metric]) -> None:
        self._metrics = metrics

    def describe(self) -> list[Metric]:
        return []

    def collect(self) -> Iterator[Metric]:
        yield from self._metrics
