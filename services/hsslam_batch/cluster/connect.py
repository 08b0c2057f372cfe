"""Connects to Ray: a new one on this machine, or a running cluster."""

import contextlib
import logging
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hsslam_batch.cluster.ray_head import expect_ray_head
from hsslam_node.errors import UserError

_STORE_BYTES = 80 << 20  # Ray's minimum; a result has some hundred bytes
_STARTS = 3  # Ray gives up after 30 s; on a busy machine its start can take as long
# A client server starts a process for each client, which now and then dies at its start
_NO_SERVER = "Starting Ray client server failed"
# If there are more workers than cores, Ray ends a worker that is idle for 1 s, as on a busy machine. A new
# worker takes more than 1 s of core time.
_KEPT = {"idle_worker_killing_time_threshold_ms": 3_600_000}
QUIET = {"RAY_USAGE_STATS_ENABLED": "0"}  # send no usage statistics


@contextlib.contextmanager
def connected(address: str, messages: Path | None = None) -> Iterator[None]:
    """Connect to Ray in the block; at its end shut down a Ray that was started here.

    A Ray that was started here does not hear SIGHUP: if the terminal goes away, running tasks finish.

    messages: file to which stdout is appended in the block, since Ray prints a page of state to stdout if a
    node dies; None: stdout stays.

    Raises:
        UserError: no Ray at the address, or one of another version.
    """
    expect_ray_head(address)
    os.environ.update(QUIET)
    import ray

    try:
        with _hang_up_blocked():
            _connect(address)
    except SystemExit:  # Ray's handler of SIGTERM
        raise KeyboardInterrupt from None
    except Exception as error:  # Ray raises many types, also Exception itself
        raise UserError(
            f"--address {address}: {_reason(error)}: expected local, auto (a cluster of this machine), "
            "HOST:PORT or ray://HOST:PORT (with RAY_AUTH_MODE=token in the environment if the cluster wants "
            "a token)"
        ) from None
    try:
        with _stdout_in(messages):
            yield
    finally:
        ray.shutdown()


def _reason(error: Exception) -> str:
    """One line without its full stop; of an error with the traceback of a server, the last one."""
    first, *more = str(error).strip().splitlines() or [type(error).__name__]
    return (more[-1] if first.endswith(":") and more else first).rstrip(".")


@contextlib.contextmanager
def _stdout_in(path: Path | None) -> Iterator[None]:
    if path is None:
        yield
        return
    with path.open("a", buffering=1) as stream, contextlib.redirect_stdout(stream):
        yield


@contextlib.contextmanager
def _hang_up_blocked() -> Iterator[None]:
    """Block SIGHUP in the block, and for good in the processes that it starts, as Ray does with SIGINT.

    One that comes meanwhile is heard after the block.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _connect(address: str) -> None:
    import ray

    options: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address == "local":
        options |= {
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
            "_system_config": _KEPT,
        }
    for last in range(1, _STARTS + 1):
        try:
            ray.init(address, **options)
            return
        except Exception as error:
            ray.shutdown()
            may_pass = address == "local" or _NO_SERVER in str(error)
            if last == _STARTS or not may_pass:
                raise
