"""Nodes of a Ray cluster on this machine; apart from the fixture, as tests call it."""

import socket
from typing import Any

_STORE_BYTES = 80 << 20  # the least that Ray takes
_PORTS = ("metrics_agent_port", "runtime_env_agent_port", "dashboard_agent_listen_port")


def node_options() -> dict[str, Any]:
    """Options of a node that starts on a busy machine, too: it waits for no port of its agents."""
    sockets = [socket.create_server(("", 0)) for _ in _PORTS]
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return dict(zip(_PORTS, ports, strict=True)) | {"object_store_memory": _STORE_BYTES}


def add_node(cluster: Any, memory_gb: float = 8.0) -> Any:
    """A node of one core."""
    memory = int(memory_gb * 1e9)
    return cluster.add_node(num_cpus=1, memory=memory, wait=True, **node_options())
