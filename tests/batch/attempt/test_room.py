"""Logs of a store wait for room on the disk of a node instead of failing one after the other."""

import contextlib
import fcntl
import os
import shutil
from pathlib import Path

import pytest

from hsslam_batch.attempt import room as room_module
from hsslam_batch.attempt.claim import LOCK
from hsslam_batch.attempt.room import SmallDiskError, room_for

_DISK_BYTES = 1000


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on a disk of a thousand bytes."""
    usage = shutil.disk_usage(tmp_path)

    def small(folder: Path) -> object:
        used = sum(p.stat().st_size for p in tmp_path.rglob("*") if p.name == "part")
        return usage._replace(free=_DISK_BYTES - used)

    monkeypatch.setattr(shutil, "disk_usage", small)
    return tmp_path


def _no_pause() -> None:
    pytest.fail("it waits")


def _folders(scratch: Path) -> list[str]:
    return sorted(path.name for path in scratch.iterdir() if path.is_dir())


def test_a_log_waits_until_another_one_leaves_the_room(scratch: Path):
    """The first is not yet fetched whole: what is still to come is kept for it, too."""
    first, looks = contextlib.ExitStack(), []
    first.enter_context(room_for(600, scratch / "a", _no_pause))
    (scratch / "a" / "part").write_bytes(bytes(100))
    with room_for(300, scratch / "b", _no_pause):
        assert not looks

    def pause() -> None:
        looks.append(len(_folders(scratch)))
        if len(looks) == 3:
            first.close()

    with room_for(500, scratch / "c", pause):
        assert looks == [2, 2, 2] and not (scratch / "a").exists()
        (scratch / "c" / "part").write_bytes(bytes(500))
    assert not _folders(scratch)


def test_a_log_that_never_fits_is_refused_at_once(scratch: Path):
    with (
        room_for(600, scratch / "a", _no_pause),
        pytest.raises(OSError, match=r"0\.0 MB free, 0\.0 MB needed") as raised,
        room_for(1100, scratch / "b", _no_pause),
    ):
        pass
    assert raised.value.filename == str(scratch) and not (scratch / "b").exists()


def test_a_log_that_is_larger_than_the_disk_is_told_apart(scratch: Path, monkeypatch):
    """No other attempt and no other file is to blame."""
    usage = shutil.disk_usage(scratch)._replace(total=_DISK_BYTES, free=10)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with (
        pytest.raises(SmallDiskError, match=r"a disk of 0\.0 MB, 0\.0 MB needed"),
        room_for(1001, scratch / "a", _no_pause),
    ):
        pass
    with (
        pytest.raises(OSError, match=r"0\.0 MB free") as raised,
        room_for(1000, scratch / "a", _no_pause),
    ):
        pass
    assert not isinstance(raised.value, SmallDiskError) and not (scratch / "a").exists()


def test_what_an_attempt_has_left_is_not_waited_for(scratch: Path):
    """A part that is kept for the next attempt, or that of a node that was killed; it goes if another log
    needs the room."""
    with room_for(600, scratch / "a", _no_pause) as room:
        (scratch / "a" / "part").write_bytes(bytes(500))
        room.is_kept = True
    with room_for(600, scratch / "a", _no_pause), room_for(400, scratch / "b", _no_pause):
        assert (scratch / "a" / "part").exists()
    with room_for(600, scratch / "a", _no_pause) as room:
        (scratch / "a" / "part").write_bytes(bytes(500))
        room.is_kept = True
    with room_for(600, scratch / "b", _no_pause):
        assert not (scratch / "a").exists()


def test_a_log_takes_the_oldest_of_what_attempts_have_left_and_no_more_than_it_needs(
    scratch: Path, monkeypatch
):
    """What cannot fit removes nothing."""
    for k, name in enumerate(("new", "old", "middle")):
        with room_for(300, scratch / name, _no_pause) as room:
            (scratch / name / "part").write_bytes(bytes(300))
            room.is_kept = True
        for path in (scratch / name).iterdir():
            os.utime(path, (age_s := 1e9 - (0, 2000, 1000)[k], age_s))
    usage = shutil.disk_usage(scratch)
    for total, error in ((usage.total, OSError), (_DISK_BYTES, SmallDiskError)):
        with monkeypatch.context() as small:
            small.setattr(shutil, "disk_usage", lambda _, total=total: usage._replace(total=total))
            with pytest.raises(error), room_for(1200, scratch / "large", _no_pause):
                pass
    assert _folders(scratch) == ["middle", "new", "old"]
    with room_for(500, scratch / "next", _no_pause):
        assert (scratch / "new").exists()
        assert not (scratch / "old").exists() and not (scratch / "middle").exists()


def test_an_attempt_that_ends_leaves_the_log_to_another_attempt_at_it(scratch: Path):
    """As after a worker was killed: its run ends some seconds after the next attempt has begun."""
    next_one = contextlib.ExitStack()
    with room_for(300, scratch / "a", _no_pause):
        (scratch / "a" / "part").write_bytes(bytes(300))
        next_one.enter_context(room_for(300, scratch / "a", _no_pause))
    assert (scratch / "a" / "part").exists()
    next_one.close()
    assert not (scratch / "a").exists()


def test_no_attempt_at_a_log_begins_while_its_folder_is_removed(scratch: Path, monkeypatch):
    """It would find its claim gone."""
    remove, is_locked = room_module.remove_fetched, []

    def try_to_begin(folder: Path) -> None:
        with (scratch / LOCK).open("a+") as stream:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                is_locked.append(folder)
        remove(folder)

    monkeypatch.setattr(room_module, "remove_fetched", try_to_begin)
    with room_for(300, scratch / "a", _no_pause):
        pass
    assert is_locked == [scratch / "a"] and not (scratch / "a").exists()
