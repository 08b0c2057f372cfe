"""The number of cores that this process may use, by its affinity and the quotas of its control groups."""

import os
from collections.abc import Iterator
from pathlib import Path

_OWN = Path("/proc/self/cgroup")
_GROUPS = Path("/sys/fs/cgroup")
_V1_MOUNTS = ("cpu", "cpu,cpuacct", "cpuacct,cpu")


def granted_cores(own: Path = _OWN, groups: Path = _GROUPS) -> float:
    """Number of cores by affinity and by the quotas of this process's control groups and their parents.

    `own`: the kernel's list of this process's groups, version 1 or 2; `groups`: their mount point.
    """
    return min([float(len(os.sched_getaffinity(0))), *_quotas(own, groups)])


def _quotas(own: Path, groups: Path) -> Iterator[float]:
    for group in _groups_of_cpu(own, groups):
        v2 = _numbers(group / "cpu.max")
        v1 = _numbers(group / "cpu.cfs_quota_us") + _numbers(group / "cpu.cfs_period_us")
        for quota in (v2, v1):
            if len(quota) == 2 and quota[0] > 0 and quota[1] > 0:
                yield quota[0] / quota[1]


def _groups_of_cpu(own: Path, groups: Path) -> Iterator[Path]:
    """The folders of this process's groups and of their parents."""
    try:
        lines = own.read_text().splitlines()
    except OSError:
        return  # no control groups
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        for mount in (groups / name for name in _V1_MOUNTS) if controllers else (groups,):
            folder = mount / path.lstrip("/")
            yield from (g for g in (folder, *folder.parents) if g.is_relative_to(mount))


def _numbers(file: Path) -> list[float]:
    """The numbers in a file, without "max"; empty if it cannot be read."""
    try:
        return [float(word) for word in file.read_text().split() if word != "max"]
    except (OSError, ValueError):
        return []
