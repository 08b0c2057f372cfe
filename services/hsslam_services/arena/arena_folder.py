"""The folder in /dev/shm of a run's shared arrays: made, owned, found dead, removed (no torch)."""

import contextlib
import fcntl
import json
import os
import shutil
import stat
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from hsslam_node.errors import UserError
from hsslam_services.arena.unsaved_marker import is_marked

SHM_ROOT = Path("/dev/shm")
_PREFIX = "hsslam-"
_OWNER = "owner.json"
_OWNER_LOCK = "owner.lock"
_POSE_COUNT = "pose_header.bin"  # begins with it


class ArenaFolder:
    """A run's folder, owned by this process until `remove` or death; the lock tells others which.

    Raises:
        UserError: the folder cannot be made.
    """

    def __init__(self, run_id: str, run_dir: Path, root: Path = SHM_ROOT) -> None:
        self.path = root / f"{_PREFIX}{run_id}"
        unlocked = root / f".{self.path.name}"  # no other process looks there
        try:
            unlocked.mkdir(mode=0o700)
            self._lock = os.open(unlocked / _OWNER_LOCK, os.O_RDWR | os.O_CREAT, 0o600)
            fcntl.flock(self._lock, fcntl.LOCK_EX)
            owner = {"pid": os.getpid(), "start_ticks": start_ticks(), "run_dir": str(run_dir)}
            (unlocked / _OWNER).write_text(json.dumps(owner))
            unlocked.rename(self.path)
        except OSError as error:
            shutil.rmtree(unlocked, ignore_errors=True)
            raise UserError(f"{self.path}: {error.strerror}: expected room for the arena") from None

    def remove(self) -> None:
        """Unlink everything; processes that still map an array keep their memory until they end."""
        remove_arena(self.path)
        self.let_go()

    def let_go(self) -> None:
        """Own the folder no more, and leave it as it is."""
        with contextlib.suppress(OSError):
            os.close(self._lock)


def disk_folder(run_dir: Path, arena_dir: Path) -> Path:
    """Where arrays of an arena that nothing writes any more lie on the disk, until the arena is removed.

    The arena of an earlier run in the folder may be kept, so each has a folder of its own.
    """
    return run_dir / ".arena" / arena_dir.name


def remove_arena(path: Path) -> None:
    """Remove an arena folder, and those of its arrays that lie on the disk; errors are ignored."""
    with contextlib.suppress(OSError):
        on_disk = disk_folder(run_dir_of(path), path)
        for link in path.glob("*.bin"):
            if link.is_symlink() and link.readlink().parent == on_disk.absolute():
                link.readlink().unlink(missing_ok=True)
        on_disk.rmdir()
        on_disk.parent.rmdir()
    shutil.rmtree(path, ignore_errors=True)


def remove_arrays(path: Path, is_kept: Callable[[str], bool]) -> None:
    """Unlink the arrays of an arena folder but those whose name is kept; no process may use them."""
    for data in sorted(path.glob("*.bin")):
        if not is_kept(data.stem):
            data.with_suffix(".json").unlink(missing_ok=True)
            data.unlink()


def remove_dead_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """Remove the folders whose owner no longer lives, and that hold no pose; returns the others.

    A folder that is marked as unsaved is neither removed nor returned: the user rescues it.
    """
    left = []
    for path in _own(root):
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
    for path in _own(root):
        with contextlib.suppress(OSError), try_own(path) as is_dead:
            if not is_dead and not is_marked(path):
                live.append(path)
    return live


def kept_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """The folders without an owner that are marked as unsaved, and that this user may rescue."""
    kept = []
    for path in _own(root):
        with contextlib.suppress(OSError), try_own(path) as is_dead:
            if is_dead and is_marked(path):
                kept.append(path)
    return kept


def foreign_arenas(root: Path = SHM_ROOT) -> list[Path]:
    """Entries with the name of an arena that are no folder of this user; the service leaves them alone."""
    return sorted(set(root.glob(f"{_PREFIX}*")) - set(_own(root)))


@contextlib.contextmanager
def owned_after_death(path: Path) -> Iterator[bool]:
    """Wait until the owner of the arena folder is dead, and own the folder in the block.

    False if the folder is gone.
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
    """Whether the supervisor that made the arena folder lives; a process id alone may be reused."""
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
    """How many poses the tracker has left in the arena folder."""
    with contextlib.suppress(OSError), (path / _POSE_COUNT).open("rb") as file:
        return int.from_bytes(file.read(8), sys.byteorder)
    return 0


def start_ticks(pid: int | None = None) -> int:
    """When a process started, in clock ticks since boot (a pid alone may be reused)."""
    stat = Path(f"/proc/{pid or os.getpid()}/stat").read_text()
    return int(stat.rpartition(")")[2].split()[19])


def _own(root: Path) -> list[Path]:
    """Arena folders that this user has made; links are not followed."""
    own = []
    for path in sorted(root.glob(f"{_PREFIX}*")):
        with contextlib.suppress(OSError):  # gone meanwhile
            of = path.lstat()
            if stat.S_ISDIR(of.st_mode) and of.st_uid == os.geteuid():
                own.append(path)
    return own


@contextlib.contextmanager
def try_own(path: Path) -> Iterator[bool]:
    """Own the arena folder in the block, if its owner is dead; whether this worked.

    Raises:
        OSError: the folder is gone, or another user's.
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
