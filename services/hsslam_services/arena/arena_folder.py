"""The arena folder of a run in /dev/shm: its creation, ownership and removal (no torch)."""

import contextlib
import errno
import fcntl
import json
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from hsslam_node.errors import MORE_SHARED_MEMORY, UserError
from hsslam_services.arena.unsaved_marker import is_marked

SHM_ROOT = Path("/dev/shm")
_PREFIX = "hsslam-"
_OWNER = "owner.json"
_OWNER_LOCK = "owner.lock"
_POSE_COUNT = "pose_header.bin"  # its first 8 bytes


class ArenaFolder:
    """A run's arena folder. A file lock marks it as owned by this process until `remove` or its death.

    Raises:
        UserError: the folder cannot be created.
    """

    def __init__(self, run_id: str, run_dir: Path, root: Path = SHM_ROOT) -> None:
        self.path = root / f"{_PREFIX}{run_id}"
        unlocked = root / f".{self.path.name}"  # other processes do not look for this name
        try:
            unlocked.mkdir(mode=0o700)
            lock = os.open(unlocked / _OWNER_LOCK, os.O_RDWR | os.O_CREAT, 0o600)
            self._lock: int | None = lock
            fcntl.flock(lock, fcntl.LOCK_EX)
            owner = {"pid": os.getpid(), "start_ticks": start_ticks(), "run_dir": str(run_dir)}
            (unlocked / _OWNER).write_text(json.dumps(owner))
            unlocked.rename(self.path)
        except OSError as error:
            shutil.rmtree(unlocked, ignore_errors=True)
            expected = (
                MORE_SHARED_MEMORY if error.errno == errno.ENOSPC else "expected a writable folder"
            )
            raise UserError(f"{self.path}: {error.strerror}: {expected}") from None

    def remove(self) -> None:
        """Remove the folder; the memory of an array is free when the last process unmaps it."""
        remove_arena(self.path)
        self.let_go()

    def let_go(self) -> None:
        """Give up ownership and keep the folder; a second call does nothing."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def disk_folder(run_dir: Path, arena_dir: Path) -> Path:
    """The folder on disk for finished arrays of an arena; `remove_arena` removes it.

    Each arena has its own: a kept arena of an earlier run may share the run folder.
    """
    return run_dir / ".arena" / arena_dir.name


def remove_arena(path: Path) -> None:
    """Remove an arena folder and its arrays on disk; ignores errors."""
    with contextlib.suppress(OSError):
        on_disk = disk_folder(run_dir_of(path), path)
        shutil.rmtree(on_disk)
        on_disk.parent.rmdir()
    shutil.rmtree(path, ignore_errors=True)


def remove_arrays(path: Path, is_kept: Callable[[str], bool]) -> None:
    """Unlink the arrays of an arena folder whose name `is_kept` rejects; no process may use them."""
    for data in sorted(path.glob("*.bin")):
        if not is_kept(data.stem):
            data.with_suffix(".json").unlink(missing_ok=True)
            data.unlink()


def remove_dead_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """Remove the folders of dead owners that hold no pose; returns those that hold poses.

    Ignores folders that wait for a rescue by the user, but not those whose watchdog died as it saved them.
    """
    left = []
    for path in _of_this_user(root):
        with contextlib.suppress(OSError), try_own(path) as is_dead:
            if not is_dead or is_marked(path):
                continue
            if pose_count(path):
                left.append(path)
            else:
                remove_arena(path)
    return left


def live_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """The folders whose owner lives."""
    live = []
    for path in _of_this_user(root):
        with contextlib.suppress(OSError), try_own(path) as is_dead:
            if not is_dead and not is_marked(path):
                live.append(path)
    return live


def kept_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """The folders of dead owners that wait for a rescue by this user."""
    kept = []
    for path in _of_this_user(root):
        with contextlib.suppress(OSError), try_own(path) as is_dead:
            if is_dead and is_marked(path):
                kept.append(path)
    return kept


def foreign_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """Entries named like an arena that are not folders of this user; the service ignores them."""
    return sorted(set(root.glob(f"{_PREFIX}*")) - set(_of_this_user(root)))


@contextlib.contextmanager
def owned_after_death(path: Path) -> Iterator[bool]:
    """Wait until the owner of the arena folder is dead, then own the folder in the block.

    Yields False if the folder is gone.
    """
    try:
        fd = os.open(path / _OWNER_LOCK, os.O_RDWR | os.O_NOFOLLOW)
    except OSError:
        yield False
        return
    try:
        fcntl.flock(fd, fcntl.LOCK_EX)
        yield path.exists()
    finally:
        os.close(fd)


def owner_lives(path: Path) -> bool:
    """Whether the supervisor that created the arena folder lives; compares process id and start time."""
    try:
        owner = json.loads((path / _OWNER).read_text())
        return start_ticks(owner["pid"]) == owner["start_ticks"]
    except (OSError, ValueError, KeyError):
        return False


def run_dir_of(path: Path) -> Path:
    """The run folder of an arena folder.

    Raises:
        OSError: the folder is gone, or not an arena.
    """
    try:
        return Path(json.loads((path / _OWNER).read_text())["run_dir"])
    except (ValueError, KeyError):
        raise FileNotFoundError(path / _OWNER) from None


def pose_count(path: Path) -> int:
    """The number of poses that the tracker wrote to the arena folder."""
    with contextlib.suppress(OSError), (path / _POSE_COUNT).open("rb") as file:
        return int.from_bytes(file.read(8), sys.byteorder)
    return 0


def start_ticks(pid: int | None = None) -> int:
    """Start time of a process, in clock ticks since boot; tells reused process ids apart."""
    stat = Path(f"/proc/{pid or os.getpid()}/stat").read_text()
    return int(stat.rpartition(")")[2].split()[19])


def _of_this_user(root: Path) -> list[Path]:
    """Arena folders that belong to this user; symbolic links are left out."""
    own = []
    for path in sorted(root.glob(f"{_PREFIX}*")):
        with contextlib.suppress(OSError):  # removed meanwhile
            found = path.lstat()
            if stat.S_ISDIR(found.st_mode) and found.st_uid == os.geteuid():
                own.append(path)
    return own


@contextlib.contextmanager
def try_own(path: Path) -> Iterator[bool]:
    """Own the arena folder in the block if its owner is dead; yields whether it is.

    Raises:
        OSError: the folder is gone, or belongs to another user.
    """
    fd = os.open(path / _OWNER_LOCK, os.O_RDWR | os.O_NOFOLLOW)
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            is_free = True
        except BlockingIOError:
            is_free = False
        yield is_free
    finally:
        os.close(fd)
