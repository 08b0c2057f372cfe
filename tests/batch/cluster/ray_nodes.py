"""Nodes of a Ray cluster on this machine; apart from the fixture, as tests call it."""

from typing import Any

STORE_BYTES = 80 << 20  # the least that Ray takes


def add_node(cluster: Any, memory_gb: float = 8.0) -> Any:
    """A node of one core."""
    return cluster.add_node(
        num_cpus=1, memory=int(memory_gb * 1e9), object_store_memory=STORE_BYTES, wait=True
    )
