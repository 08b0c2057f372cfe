"""Limits a process and its children to a share of the processor, by a Linux control group (needs root)."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

_V2, _V1 = Path("/sys/fs/cgroup"), Path("/sys/fs/cgroup/cpu")
_PERIOD_US = 100_000  # the kernel's default


class NoQuotaError(Exception):
    """This machine allows no control group; the text gives the reason."""


@contextlib.contextmanager
def cpu_quota(pid: int, cores: float, machine_cores: int) -> Iterator[None]:
    """Limit a process, and those that it starts from now on, to `cores` of the first `machine_cores` cores.

    Raises:
        NoQuotaError: no control groups, or no permission.
    """
    chosen = sorted(os.sched_getaffinity(0))[:machine_cores]
    os.sched_setaffinity(pid, chosen)
    root = _V2 if (_V2 / "cgroup.controllers").exists() else _V1
    group = root / f"hsslam-bench-{secrets.token_hex(4)}"
    try:
        group.mkdir()
        quota_us = round(cores * _PERIOD_US)
        if root is _V2:
            (group / "cpu.max").write_text(f"{quota_us} {_PERIOD_US}")
        else:
            (group / "cpu.cfs_period_us").write_text(str(_PERIOD_US))
            (group / "cpu.cfs_quota_us").write_text(str(quota_us))
        (group / "cgroup.procs").write_text(str(pid))
    except OSError as error:
        with contextlib.suppress(OSError):
            group.rmdir()
        raise NoQuotaError(f"{group}: {error.strerror}: expected control groups and root") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # `left_behind` reports processes that are still in it
            group.rmdir()
