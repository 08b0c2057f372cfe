"""A Ray cluster on this machine: a head without cores, and nodes that a test adds and kills."""

from collections.abc import Iterator
from typing import Any

import pytest

from tests.batch.cluster.ray_nodes import node_options


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """The cluster; its address is `cluster.address`."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "include_dashboard": False, **node_options()}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    yield cluster
    cluster.shutdown()
