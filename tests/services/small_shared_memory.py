"""A command with a file system of its own, as a small /dev/shm."""

import os
from pathlib import Path

import pytest


def with_shared_memory(size: str) -> tuple[str, ...]:
    """What to put before a command; `size` as of tmpfs, such as "24m". Skips the test without root."""
    return with_tmpfs(f"size={size}", Path("/dev/shm"))


def with_tmpfs(options: str, place: Path) -> tuple[str, ...]:
    """What to put before a command that sees a tmpfs with these options there; skips without root."""
    if os.geteuid() != 0:
        pytest.skip("mounting a tmpfs needs root")
    if os.system("unshare -m true 2>/dev/null") != 0:
        pytest.skip("this machine does not allow mount namespaces")
    mount = f'mount -t tmpfs -o {options} tmpfs "$0" && exec "$@"'
    return ("unshare", "-m", "sh", "-c", mount, str(place))
