"""A Ray cluster on this machine, apart as rows and tests use it: a head without cores, and nodes."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hsslam_batch.cluster.connect import QUIET

_STORE_BYTES = 80 << 20  # the least that Ray takes
_PORTS = ("metrics_agent_port", "runtime_env_agent_port", "dashboard_agent_listen_port")


@contextmanager
def ray_cluster() -> Iterator[Any]:
    """The cluster, a `ray.cluster_utils.Cluster`; it ends with the block."""
    os.environ.update(QUIET)
    from ray.cluster_utils import Cluster

    head = {"num_cpus": 0, "include_dashboard": False, **_node_options()}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    try:
        yield cluster
    finally:
        cluster.shutdown()


def add_node(cluster: Any, memory_gb: float = 8.0) -> Any:
    """A node of one core."""
    memory = int(memory_gb * 1e9)
    return cluster.add_node(num_cpus=1, memory=memory, wait=True, **_node_options())


def _node_options() -> dict[str, Any]:
    """Options of a node that starts on a busy machine, too: it waits for no port of its agents."""
    sockets = [socket.create_server(("", 0)) for _ in _PORTS]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return dict(zip(_PORTS, ports, strict=True)) | {"object_store_memory": _STORE_BYTES}
