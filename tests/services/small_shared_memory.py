"""A command with a small /dev/shm of its own."""

import os

import pytest


def with_shared_memory(size: str) -> tuple[str, ...]:
    """What to put before a command; `size` as of tmpfs, such as "24m". Skips the test without root."""
    if os.geteuid() != 0:
        pytest.skip("mounting a small tmpfs needs root")
    if os.system("unshare -m true 2>/dev/null") != 0:
        pytest.skip("this machine does not allow mount namespaces")
    mount = f'mount -t tmpfs -o size={size} tmpfs /dev/shm && exec "$@"'
    return ("unshare", "-m", "sh", "-c", mount, "sh")
