"""Finds the control groups that limit this process's core time; apart, as two modules read them."""

from collections.abc import Iterator
from pathlib import Path

OWN_GROUPS = Path("/proc/self/cgroup")  # the kernel's list of this process's groups, version 1 or 2
GROUPS = Path("/sys/fs/cgroup")  # their mount point
_V1_MOUNTS = ("cpu", "cpu,cpuacct", "cpuacct,cpu")


def cpu_groups(own: Path = OWN_GROUPS, groups: Path = GROUPS) -> Iterator[Path]:
    """The folders of this process's groups and of their parents; none without control groups."""
    try:
        lines = own.read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers and "cpu" not in controllers.split(","):
            continue
        for mount in (groups / name for name in _V1_MOUNTS) if controllers else (groups,):
            folder = mount / path.lstrip("/")
            yield from (g for g in (folder, *folder.parents) if g.is_relative_to(mount))
