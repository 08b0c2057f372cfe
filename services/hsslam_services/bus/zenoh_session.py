"""Zenoh sessions: the run has one router, on loopback; all other processes are its clients.

Zenoh locks its shared memory in the sender and in each receiver. Messages beyond the limit of locked memory
(`ulimit -l`) are lost silently (zenoh issues 2787, 2788), so this module sizes the pools by that limit.
"""

import contextlib
import json
import os
import re
import resource
import secrets
import socket
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import zenoh

from hsslam_node.errors import MORE_SHARED_MEMORY, OutOfMemoryError, UserError
from hsslam_services.bus.dead_pools import POOL_BYTES, pool_bytes

_SHARED = "transport/shared_memory"
_POOL = f"{_SHARED}/transport_optimization/pool_size"
_FROM = f"{_SHARED}/transport_optimization/message_size_threshold"
_LEAST_POOL_BYTES = 2**20
_LARGE_BYTES = 65_536  # frames and meshes; smaller messages are cheaper on the socket
_NEVER = 2**40
# No subscriber gets a message with this key: wildcards do not match a part that begins with @.
_NOBODY = "@hsslam/nobody"
_ALL_POOLS_BYTES = 16 * POOL_BYTES  # of all senders that a process may receive from
_BESIDE_POOL_BYTES = 3 * 2**19  # zenoh's own tables
_CAP_IPC_LOCK = 14  # capabilities(7): the limit does not apply
Settings = Mapping[str, object]
_CONNECT_TIMEOUT_S = 10.0
_THREADS = 8  # of a connected session
_PORTS = range(16_384, 32_768)  # Linux gives connections those above
NO_SETTINGS: Settings = MappingProxyType({})
# for a router of ROS nodes: they are peers and find one another by the gossip of the router
INTRODUCES_PEERS: Settings = MappingProxyType({"scouting/gossip/enabled": True})
_DROP = "transport/link/tx/queue/congestion_control/drop"
# Of clients that may be on another machine. By itself zenoh drops a message that the link has not taken in
# 50 ms: most raw frames below 200 Mbit/s. The router has limits of its own, because of frozen subscribers.
OVER_NETWORK: Settings = MappingProxyType(
    {f"{_DROP}/max_wait_before_drop_fragments": 1_000_000}
)  # us
_COMMON: Settings = {
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,
    "scouting/delay": 0,  # no scouting, so open at once
    "timestamping/enabled": True,  # the caches of AdvancedPublisher need it
    "queries_default_timeout": 3000,  # ms; a frozen publisher delays a new subscriber by this
    "transport/link/rx/max_message_size": 512 * 2**20,
    # if a peer reads nothing for 1 s while buffers are full, zenoh cuts the link; the peer reconnects
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,  # us
    f"{_DROP}/wait_before_drop": 5_000,  # us
}


def shared_memory_settings() -> dict[str, object]:
    """Settings of any session: use shared memory if the pools of all senders fit into the limit."""
    is_roomy = lockable_bytes() >= _ALL_POOLS_BYTES
    return {f"{_SHARED}/enabled": is_roomy, _POOL: POOL_BYTES, _FROM: _LARGE_BYTES}


def shared_memory_of_run(
    has_camera: bool, sends_frames: bool, process_number: int = 0
) -> dict[str, object]:
    """Settings of a process of a run or of its router; if the limit is low, only the camera gets a pool.

    `sends_frames`: whether this is the run's first camera process; the pool of a dead one still counts.
    `has_camera`: whether a process of the run sends the frames; frames of other programs go by socket.
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
    """The memory that this process may lock."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return sys.maxsize if limit == resource.RLIM_INFINITY or _is_exempt() else limit


def _is_exempt() -> bool:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    effective = next(line for line in status.splitlines() if line.startswith("CapEff:"))
    return bool(int(effective.split()[1], 16) >> _CAP_IPC_LOCK & 1)


def open_router(
    *endpoints: str, settings: Settings = NO_SETTINGS, expected: str = "a free port"
) -> zenoh.Session:
    """Open the router of a run; it listens on `endpoints` only (such as `tcp/127.0.0.1:7447`).

    `settings`: further zenoh settings. `expected`: end of the error if the port is taken.

    Raises:
        UserError: the port is taken, the endpoint is invalid, or no threads can start.
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
    """Open a client session with the router at `endpoint`.

    Raises:
        UserError: no router answers within `timeout_s`, it refuses this client, or no threads can start.
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
            raise UserError(f"zenoh endpoint {endpoint}: expected a router within {timeout_s:g} s")
        time.sleep(0.005)
    return session


def open_shared_memory(session: zenoh.Session) -> None:
    """Make the session open its pool of shared memory, by a large message that reaches no subscriber.

    zenoh opens the pool at the first large message, and sends this one by socket, in pieces: it is lost if a
    receiver does not read them in time.
    """
    session.put(_NOBODY, bytes(_LARGE_BYTES), congestion_control=zenoh.CongestionControl.DROP)


def free_endpoint() -> str:
    """A loopback endpoint with a free port, which the kernel gives to no connection in the meantime."""
    while True:
        port = _PORTS.start + secrets.randbelow(len(_PORTS))
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return f"tcp/127.0.0.1:{port}"


def _config(settings: Settings) -> zenoh.Config:
    config = zenoh.Config()
    for key, value in {**_COMMON, **shared_memory_settings(), **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _expect_threads() -> None:
    """Check that a session can start its threads: zenoh panics or aborts if it cannot."""
    is_over = threading.Event()
    started: list[threading.Thread] = []
    try:
        while len(started) < _THREADS:
            thread = threading.Thread(target=is_over.wait)
            thread.start()
            started.append(thread)
    except RuntimeError as error:
        raise UserError(
            f"zenoh: {error}: expected room for {_THREADS} more threads (ulimit -u; docker: --pids-limit)"
        ) from None
    finally:
        is_over.set()
        for thread in started:
            thread.join()


def _expect_shared_memory(reason: str) -> None:
    if "shm segment" in reason:
        shm = os.statvfs("/dev/shm")
        raise OutOfMemoryError(
            f"/dev/shm: zenoh needs some thousand bytes for a session, {shm.f_bavail * shm.f_frsize} "
            f"are free: {MORE_SHARED_MEMORY} ({reason})"
        ) from None


def _reason(error: Exception) -> str:
    """The error of the operating system, or zenoh's text without source locations."""
    text = str(error).splitlines()[0]
    if said := re.search(r"([A-Z][a-z ]+) \(os error \d+\)", text):
        return said[1]
    return re.sub(r" at /\S+\.rs:\d+\.?", "", text)[:160].rstrip(".")
