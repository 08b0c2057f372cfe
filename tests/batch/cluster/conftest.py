"""A Ray cluster on this machine, and zenoh's pools of before; apart, as several tests use them."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from hsslam_bench.batch.ray_nodes import ray_cluster
from tests.batch.cluster.runs_of_batch import loose_pools


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A head without cores, to which a test adds nodes; its address is `cluster.address`."""
    with ray_cluster() as cluster:
        yield cluster


@pytest.fixture
def pools() -> set[Path]:
    """The pools of zenoh that no process has open when the test begins; `nothing_left` expects no others."""
    return loose_pools()
