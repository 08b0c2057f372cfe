"""Zenoh sessions of this system: one router on loopback, every other process its client.

Zenoh locks its shared memory in the sender and in every receiver. Messages beyond the limit of locked memory
(`ulimit -l`) are lost silently (zenoh issues 2787, 2788), so pools are sized by that limit.
"""

import json
import os
import re
import resource
import socket
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import zenoh

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_services.bus.dead_pools import POOL_BYTES, pool_bytes

_SHARED = "transport/shared_memory"
_POOL = f"{_SHARED}/transport_optimization/pool_size"
_FROM = f"{_SHARED}/transport_optimization/message_size_threshold"
_LEAST_POOL_BYTES = 2**20
_LARGE_BYTES = 65_536  # frames and meshes; what is smaller is cheaper on the socket
_NEVER = 2**40
_ALL_POOLS_BYTES = 16 * POOL_BYTES  # of all senders of a run that a process may come to hear
_BESIDE_POOL_BYTES = 3 * 2**19  # zenoh's own tables
_CAP_IPC_LOCK = 14  # capabilities(7): the limit does not count
Settings = Mapping[str, object]
_CONNECT_TIMEOUT_S = 10.0
_THREADS = 8  # of a session with a link
NO_SETTINGS: Settings = MappingProxyType({})
# of a router for ROS nodes: they are peers, and hear one another after a router has told each of the others
INTRODUCES_PEERS: Settings = MappingProxyType({"scouting/gossip/enabled": True})
_COMMON: Settings = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # no scouting, so open at once
    "timestamping/enabled": True,  # the caches of AdvancedPublisher need it
    "queries_default_timeout": 3000,  # ms; by so much a frozen publisher delays a new subscriber
    "transport/link/rx/max_message_size": 512 * 2**20,
    # a peer that takes nothing for 1 s with full buffers is cut off; it reconnects
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,  # us
    "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 5_000,  # us
}


def shared_memory_settings() -> dict[str, object]:
    """Of any session: shared memory if there is room for the pools of all."""
    is_roomy = lockable_bytes() >= _ALL_POOLS_BYTES
    return {f"{_SHARED}/enabled": is_roomy, _POOL: POOL_BYTES, _FROM: _LARGE_BYTES}


def shared_memory_of_run(
    has_camera: bool, sends_frames: bool, process_number: int = 0
) -> dict[str, object]:
    """Of a process of a run, or its router: where there is little room, it is the camera's alone.

    `sends_frames`: of the first camera; the pool of one that died still counts. `has_camera`: whether a
    process of the run sends the frames. Those of another program may be in any pool, so sockets carry them.
    """
    lockable = lockable_bytes()
    if lockable >= _ALL_POOLS_BYTES:
        return {_POOL: pool_bytes(process_number)}
    pool = pool_bytes(process_number, most_pool_bytes())
    if pool < _LEAST_POOL_BYTES or not has_camera:
        return {}
    threshold = _LARGE_BYTES if sends_frames else _NEVER
    return {f"{_SHARED}/enabled": True, _POOL: pool, _FROM: threshold}


def most_pool_bytes() -> int:
    """Size of the largest pool of a run."""
    return min(lockable_bytes() - _BESIDE_POOL_BYTES, POOL_BYTES)


def lockable_bytes() -> int:
    """How much memory this process may lock."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return sys.maxsize if limit == resource.RLIM_INFINITY or _is_exempt() else limit


def _is_exempt() -> bool:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    effective = next(line for line in status.splitlines() if line.startswith("CapEff:"))
    return bool(int(effective.split()[1], 16) >> _CAP_IPC_LOCK & 1)


def open_router(
    *endpoints: str, settings: Settings = NO_SETTINGS, expected: str = "a free port"
) -> zenoh.Session:
    """The router of a run, listening on `endpoints` only (such as `tcp/127.0.0.1:7447`).

    `settings`: of zenoh, beside those of this system. `expected`: what the error of a taken port advises.

    Raises:
        UserError: the port is taken, it is no zenoh endpoint, or no threads can be started.
        OutOfMemoryError: /dev/shm is full.
    """
    _expect_threads()
    own = {
        "mode": "router",
        "listen/endpoints": endpoints,
        "listen/exit_on_failure": True,
        "listen/timeout_ms": 0,
    }
    try:
        return zenoh.open(_config({**own, **settings}))
    except zenoh.ZError as error:
        reason = _reason(error)
        _expect_shared_memory(reason)
        is_elsewhere = reason.startswith(("Cannot assign", "failed to lookup"))
        expected = "an address of this machine" if is_elsewhere else expected
        raise UserError(
            f"zenoh endpoint {endpoints[0]}: cannot listen there: {reason}: expected {expected}"
        ) from None


def open_client(
    endpoint: str, timeout_s: float = _CONNECT_TIMEOUT_S, settings: Settings = NO_SETTINGS
) -> zenoh.Session:
    """A client session that is connected to the router at `endpoint`.

    Raises:
        UserError: no router answers there within `timeout_s`, it does not take this client, or no
            threads can be started.
        OutOfMemoryError: /dev/shm is full.
    """
    _expect_threads()
    own = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": int(timeout_s * 1000),
        "connect/exit_on_failure": True,
    }
    deadline = time.monotonic() + timeout_s
    try:
        session = zenoh.open(_config({**own, **settings}))
    except zenoh.ZError as error:
        reason = _reason(error)
        _expect_shared_memory(reason)
        expected = "a router"
        if endpoint.startswith("tls/"):
            expected = "a router that accepts this certificate and has one of the same CA"
        raise UserError(f"zenoh endpoint {endpoint}: expected {expected} ({reason})") from None
    while not session.info.routers_zid():
        if time.monotonic() > deadline:
            session.close()
            raise UserError(f"zenoh endpoint {endpoint}: no router within {timeout_s:g} s")
        time.sleep(0.005)
    return session


def free_endpoint() -> str:
    """A loopback endpoint whose port is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _config(settings: Settings) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {**_COMMON, **shared_memory_settings(), **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _expect_threads() -> None:
    """Start as many threads as a session does, and let them end: zenoh panics or aborts without them."""
    is_over = threading.Event()
    started: list[threading.Thread] = []
    try:
        while len(started) < _THREADS:
            thread = threading.Thread(target=is_over.wait)
            thread.start()
            started.append(thread)
    except RuntimeError as error:
        raise UserError(
            f"zenoh: {error}: expected room for {_THREADS} more (ulimit -u; docker: --pids-limit)"
        ) from None
    finally:
        is_over.set()
        for thread in started:
            thread.join()


def _expect_shared_memory(reason: str) -> None:
    if "shm segment" in reason:
        shm = os.statvfs("/dev/shm")
        raise OutOfMemoryError(
            f"/dev/shm: zenoh needs thousands of bytes for a session, {shm.f_bavail * shm.f_frsize} "
            f"are free: expected more shared memory (docker: --shm-size) ({reason})"
        ) from None


def _reason(error: Exception) -> str:
    """What the operating system says, or zenoh's own words without the places in its source."""
    text = str(error).splitlines()[0]
    if said := re.search(r"([A-Z][a-z ]+) \(os error \d+\)", text):
        return said[1]
    return re.sub(r" at /\S+\.rs:\d+\.?", "", text)[:160].rstrip(".")
