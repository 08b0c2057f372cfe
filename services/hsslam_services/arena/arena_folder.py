"""The folder in /dev/shm of a run's shared arrays: made, owned, found dead, removed (no torch)."""

import contextlib
import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from hsslam_node.errors import UserError

SHM_ROOT = Path("/dev/shm")
_PREFIX = "hsslam-"
_OWNER_LOCK = "owner.lock"


class ArenaFolder:
    """A run's folder, owned by this process until `remove` or death; the lock tells others which.

    Raises:
        UserError: the folder cannot be made.
    """

    def __init__(self, run_id: str, run_dir: Path, root: Path = SHM_ROOT) -> None:
        self.path = root / f"{_PREFIX}{run_id}"
        unlocked = root / f".{self.path.name}"  # nobody else looks there
        try:
            unlocked.mkdir(mode=0o700)
            self._lock = os.open(unlocked / _OWNER_LOCK, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            owner = {"pid": os.getpid(), "start_ticks": start_ticks(), "run_dir": str(run_dir)}
            (unlocked / "owner.json").write_text(json.dumps(owner))
            unlocked.rename(self.path)
        except OSError as error:
            shutil.rmtree(unlocked, ignore_errors=True)
            raise UserError(f"{self.path}: {error.strerror}: expected room for the arena") from None

    def remove(self) -> None:
        """Unlink everything; processes that still map an array keep their memory until they end."""
        shutil.rmtree(self.path, ignore_errors=True)
        with contextlib.suppress(OSError):
            os.close(self._lock)


def remove_arrays(path: Path, is_kept: Callable[[str], bool]) -> None:
    """Unlink the arrays of an arena folder but those whose name is kept; nobody may use them."""
    for data in sorted(path.glob("*.bin")):
        if not is_kept(data.stem):
            data.with_suffix(".json").unlink(missing_ok=True)
            data.unlink()


def remove_dead_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """Remove the folders whose owner no longer lives; returns what was removed."""
    removed = []
    for path in sorted(root.glob(f"{_PREFIX}*")):
        with contextlib.suppress(OSError), _try_lock(path / _OWNER_LOCK) as is_dead:
            if is_dead:
                shutil.rmtree(path, ignore_errors=True)
                removed.append(path)
    return removed


def live_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """The folders whose owner lives."""
    live = []
    for path in sorted(root.glob(f"{_PREFIX}*")):
        with contextlib.suppress(OSError), _try_lock(path / _OWNER_LOCK) as is_dead:
            if not is_dead:
                live.append(path)
    return live


def wait_for_owner_death(path: Path) -> None:
    """Return when the owner of the arena folder is dead, or has removed it."""
    try:
        fd = os.open(path / _OWNER_LOCK, os.O_RDWR)
    except OSError:
        return
    try:
        fcntl.flock(fd, fcntl.LOCK_EX)
    finally:
        os.close(fd)


def start_ticks(pid: int | None = None) -> int:
    """When a process started, in clock ticks since boot (a pid alone may be reused)."""
    stat = Path(f"/proc/{pid or os.getpid()}/stat").read_text()
    return int(stat.rpartition(")")[2].split()[19])


@contextlib.contextmanager
def _try_lock(path: Path) -> Iterator[bool]:
    fd = os.open(path, os.O_RDWR)
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_free = True
        except BlockingIOError:
            is_free = False
        yield is_free
    finally:
        os.close(fd)
