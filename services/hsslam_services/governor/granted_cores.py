"""The cores that this process may use, by affinity and quotas; apart, as not only the governor asks."""

import os
from collections.abc import Iterator
from pathlib import Path

from hsslam_services.governor.cpu_groups import GROUPS, OWN_GROUPS, cpu_groups


def granted_cores(own: Path = OWN_GROUPS, groups: Path = GROUPS) -> float:
    """Number of cores by affinity and by the quotas of this process's control groups and their parents.

    `own`, `groups`: as in `cpu_groups`.
    """
    return min([float(len(os.sched_getaffinity(0))), *_quotas(own, groups)])


def _quotas(own: Path, groups: Path) -> Iterator[float]:
    for group in cpu_groups(own, groups):
        v2 = _numbers(group / "cpu.max")
        v1 = _numbers(group / "cpu.cfs_quota_us") + _numbers(group / "cpu.cfs_period_us")
        for quota in (v2, v1):
            if len(quota) == 2 and quota[0] > 0 and quota[1] > 0:
                yield quota[0] / quota[1]


def _numbers(file: Path) -> list[float]:
    """The numbers in a file, without "max"; empty if it cannot be read."""
    try:
        return [float(word) for word in file.read_text().split() if word != "max"]
    except (OSError, ValueError):
        return []
