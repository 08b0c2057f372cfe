"""A Ray cluster on this machine; apart, as several tests use it."""

from collections.abc import Iterator
from typing import Any

import pytest

from hsslam_bench.batch.ray_nodes import ray_cluster


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A head without cores, to which a test adds nodes; its address is `cluster.address`."""
    with ray_cluster() as cluster:
        yield cluster
