"""Connecting to Ray: one of its own on this machine, or a cluster that is there."""

import contextlib
import logging
import os
from collections.abc import Iterator
from pathlib import Path

from hsslam_node.errors import UserError

_STORE_BYTES = 80 << 20  # the least that Ray takes; results are some hundred bytes each
_STARTS = 3  # Ray gives up after 30 s, which its own start can take if the machine has other work
# Ray ends a worker that waits for a second, as on a busy machine, if there are more than cores; then it
# starts another, which takes more than a second of core time.
_KEPT = {"idle_worker_killing_time_threshold_ms": 3_600_000}
QUIET = {"RAY_USAGE_STATS_ENABLED": "0"}  # Ray reports to its makers otherwise


@contextlib.contextmanager
def connected(address: str, messages: Path | None = None) -> Iterator[None]:
    """Ray is there in the block; one of its own ends with it.

    messages: file to which stdout is appended in the block, as Ray prints a page of its state on it if a node
    dies; None: stdout stays.

    Raises:
        UserError: no Ray at the address, or one of another version.
    """
    os.environ.update(QUIET)
    import ray

    try:
        _connect(address)
    except Exception as error:  # of many kinds, Exception itself among them
        reason = next(iter(str(error).strip().splitlines()), type(error).__name__)
        raise UserError(
            f"--address {address}: {reason}: expected local, auto (a cluster of this machine), "
            "HOST:PORT or ray://HOST:PORT"
        ) from None
    try:
        with _stdout_in(messages):
            yield
    finally:
        ray.shutdown()


@contextlib.contextmanager
def _stdout_in(path: Path | None) -> Iterator[None]:
    if path is None:
        yield
        return
    with path.open("a", buffering=1) as stream, contextlib.redirect_stdout(stream):
        yield


def _connect(address: str) -> None:
    import ray

    common = {"log_to_driver": False, "logging_level": logging.ERROR}
    if address != "local":
        ray.init(address, **common)
        return
    for last in range(1, _STARTS + 1):
        try:
            ray.init(
                "local",
                include_dashboard=False,
                object_store_memory=_STORE_BYTES,
                _system_config=_KEPT,
                **common,
            )
            return
        except Exception:
            ray.shutdown()
            if last == _STARTS:
                raise
