"""What zenoh passes through shared memory, given how much memory a process may lock.

Zenoh locks every pool, in its sender and in all who hear it, and keeps it locked after the sender's
death. What does not fit under the limit (`ulimit -l`) is lost without a word (zenoh issues 2787, 2788).
"""

import resource
import sys
from pathlib import Path

_SHARED = "transport/shared_memory"
_POOL = f"{_SHARED}/transport_optimization/pool_size"
_FROM = f"{_SHARED}/transport_optimization/message_size_threshold"
_POOL_BYTES = 32 * 2**20
_LEAST_POOL_BYTES = 2**20
_LARGE_BYTES = 65_536  # frames and meshes; what is smaller is cheaper on the socket
_NEVER = 2**40
_ALL_POOLS_BYTES = 16 * _POOL_BYTES  # of all senders of a run that a process may come to hear
_BESIDE_POOL_BYTES = 3 * 2**19  # zenoh's own tables
_CAP_IPC_LOCK = 14  # capabilities(7): the limit does not count


def shared_memory_settings() -> dict[str, object]:
    """Of any session: shared memory if there is room for the pools of all."""
    is_roomy = lockable_bytes() >= _ALL_POOLS_BYTES
    return {f"{_SHARED}/enabled": is_roomy, _POOL: _POOL_BYTES, _FROM: _LARGE_BYTES}


def shared_memory_of_run(source: str, sends_frames: bool) -> dict[str, object]:
    """Of a process of a run, or its router: where there is little room, it is the camera's alone.

    `sends_frames`: of the first camera; the pool of one that died still counts. Frames that come from
    outside (`zenoh:`) may be in any pool: then they come through sockets.
    """
    lockable = lockable_bytes()
    pool = min(lockable - _BESIDE_POOL_BYTES, _POOL_BYTES)
    if lockable >= _ALL_POOLS_BYTES or pool < _LEAST_POOL_BYTES or source.startswith("zenoh:"):
        return {}
    threshold = _LARGE_BYTES if sends_frames else _NEVER
    return {f"{_SHARED}/enabled": True, _POOL: pool, _FROM: threshold}


def lockable_bytes() -> int:
    """How much memory this process may lock."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return sys.maxsize if limit == resource.RLIM_INFINITY or _is_exempt() else limit


def _is_exempt() -> bool:
    status = Path("/proc/self/status").read_text(encoding="ascii")
    effective = next(line for line in status.splitlines() if line.startswith("CapEff:"))
    return bool(int(effective.split()[1], 16) >> _CAP_IPC_LOCK & 1)
