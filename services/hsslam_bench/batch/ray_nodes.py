"""Starts a Ray cluster on this machine: a head without cores, and nodes; apart, as rows and tests use it."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hsslam_batch.cluster.connect import QUIET

_STORE_BYTES = 80 << 20  # Ray's minimum
_PORTS = ("metrics_agent_port", "runtime_env_agent_port", "dashboard_agent_listen_port")


@contextmanager
def ray_cluster(**head_options: Any) -> Iterator[Any]:
    """A `ray.cluster_utils.Cluster`, which is shut down at the end of the block."""
    os.environ.update(QUIET)
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "include_dashboard": False, **_node_options(), **head_options}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    try:
        yield cluster
    finally:
        cluster.shutdown()


def add_node(cluster: Any, memory_gb: float = 8.0) -> Any:
    """Add a node of one core."""
    memory = int(memory_gb * 1e9)
    return cluster.add_node(num_cpus=1, memory=memory, wait=True, **_node_options())


def _node_options() -> dict[str, Any]:
    """Options of a node with fixed ports for its agents, so that it also starts on a busy machine."""
    sockets = [socket.create_server(("", 0)) for _ in _PORTS]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return dict(zip(_PORTS, ports, strict=True)) | {"object_store_memory": _STORE_BYTES}
