"""Full rows of poses lie on the disk: every process reads them as before, and the end removes them."""

import shutil
import threading
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.map.pose_log import LOST, SLAB_ROWS, PoseLog, pose_row
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import ArenaFolder, disk_folder
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.full_arrays import FullArrays


class _Moved(Arena):
    """Says when it has tried to move an array."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.tried = threading.Semaphore(0)

    def move_to_disk(self, name: str, folder: Path) -> None:
        try:
            super().move_to_disk(name, folder)
        finally:
            self.tried.release()


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "shm").mkdir()
    (tmp_path / "run").mkdir()
    return ArenaFolder("1", tmp_path / "run", tmp_path / "shm")


def _row(index: int) -> np.ndarray:
    T = np.eye(4)
    T[0, 3] = index
    return pose_row(
        index=index, source_stamp_ns=index, stamp_ns=index, publish_ns=index, status=1, keyframe=-1,
        T_world_cam=T, T_keyframe_cam=np.eye(4), quality=0.5, map_version=1,
    )  # fmt: skip


def _filled(arena: _Moved, run_dir: Path, rows: int, told: list) -> PoseLog:
    log = PoseLog(arena, FullArrays(arena, run_dir, lambda *event: told.append(event)).add)
    for index in range(log.count, rows):
        log.append(_row(index))
    return log


def test_full_rows_are_on_the_disk_and_read_as_before(folder, tmp_path):
    arena, told = _Moved(folder.path), []
    log = _filled(arena, tmp_path / "run", 2 * SLAB_ROWS + 5, told)
    assert arena.tried.acquire(timeout=30) and arena.tried.acquire(timeout=30)
    in_memory = [path.name for path in folder.path.glob("pose_log.*.bin") if not path.is_symlink()]
    assert in_memory == ["pose_log.002.bin"] and told == []
    for each in (log, PoseLog(Arena(folder.path)), PoseLog(ArenaView(folder.path))):
        assert each.rows()["T_world_cam"][:, 0, 3].tolist() == list(range(2 * SLAB_ROWS + 5))
    found = log.find(0, 3)
    assert found is not None and found["index"] == 3
    [on_disk] = [
        path for path in disk_folder(tmp_path / "run", folder.path).iterdir() if "000" in path.name
    ]
    assert on_disk.stat().st_mode & 0o777 == 0o600
    folder.remove()
    assert not folder.path.exists() and list((tmp_path / "run").iterdir()) == []


def test_a_restarted_tracker_moves_what_its_predecessor_did_not(folder, tmp_path):
    plain = PoseLog(Arena(folder.path))
    for index in range(SLAB_ROWS + 1):
        plain.append(_row(index))
    arena = _Moved(folder.path)
    _filled(arena, tmp_path / "run", SLAB_ROWS + 2, [])
    assert arena.tried.acquire(timeout=30)
    assert (folder.path / "pose_log.000.bin").is_symlink()


def test_without_room_on_the_disk_rows_stay_in_memory_and_it_is_reported_once(folder, tmp_path):
    on_disk = disk_folder(tmp_path / "run", folder.path)
    on_disk.parent.mkdir()
    on_disk.write_text("a file in the place of the folder")
    arena, told = _Moved(folder.path), []
    log = _filled(arena, tmp_path / "run", 2 * SLAB_ROWS + 5, told)
    assert arena.tried.acquire(timeout=30) and arena.tried.acquire(timeout=30)
    assert len(log.rows()) == 2 * SLAB_ROWS + 5
    assert not (folder.path / "pose_log.000.bin").is_symlink()
    [(level, text)] = told
    assert level == "warning" and "pose_log.000 stays in shared memory for now" in text
    on_disk.unlink()  # there is room again
    for index in range(2 * SLAB_ROWS + 5, 3 * SLAB_ROWS + 1):
        log.append(_row(index))
    for _ in range(3):
        assert arena.tried.acquire(timeout=30)
    assert all((folder.path / f"pose_log.00{k}.bin").is_symlink() for k in range(3))
    assert len(log.rows()) == 3 * SLAB_ROWS + 1 and len(told) == 1


def test_two_arenas_of_one_run_folder_have_files_of_their_own(folder, tmp_path):
    """That of an earlier run is kept until its results are rescued."""
    later = ArenaFolder("2", tmp_path / "run", tmp_path / "shm")
    logs = []
    for of_run, first in ((folder, 0), (later, 10_000)):
        arena = _Moved(of_run.path)
        log = PoseLog(arena, FullArrays(arena, tmp_path / "run", lambda *_: None).add)
        for index in range(first, first + SLAB_ROWS + 1):
            log.append(_row(index))
        assert arena.tried.acquire(timeout=30)
        logs.append(log)
    for of_run, first in ((folder, 0), (later, 10_000)):
        rows = PoseLog(Arena(of_run.path)).rows()
        assert rows["index"].tolist() == list(range(first, first + SLAB_ROWS + 1))
    folder.remove()
    assert len(PoseLog(Arena(later.path)).rows()) == SLAB_ROWS + 1
    later.remove()
    assert list((tmp_path / "run").iterdir()) == []


def test_an_array_whose_file_on_the_disk_is_gone_is_an_error_and_not_zeros(folder, tmp_path):
    arena = _Moved(folder.path)
    _filled(arena, tmp_path / "run", SLAB_ROWS + 1, [])
    assert arena.tried.acquire(timeout=30)
    (folder.path / "pose_log.000.bin").readlink().unlink()
    with pytest.raises(FileNotFoundError):
        Arena(folder.path).open("pose_log.000")


def test_a_reader_of_a_growing_log_keeps_no_memory_of_rows_on_the_disk(folder, tmp_path):
    arena, told = _Moved(folder.path), []
    reader = PoseLog(Arena(folder.path))
    for k in range(4):
        _filled(arena, tmp_path / "run", k * SLAB_ROWS + 5, told)
        assert sum(map(len, reader.slabs(range(k * SLAB_ROWS, reader.count)))) == 5
    for _ in range(3):
        assert arena.tried.acquire(timeout=30)
    mapped = Path("/proc/self/maps").read_text().splitlines()
    assert not [line for line in mapped if "pose_log." in line and line.endswith("(deleted)")]


@pytest.mark.parametrize("of", [Arena, ArenaView])
@pytest.mark.parametrize("fault", ["cut", "bad sector"])
def test_poses_that_the_disk_does_not_give_are_lost_and_all_others_are_read(
    folder, tmp_path, of, fault
):
    """A process that mapped the file would be killed by SIGBUS."""
    arena = _Moved(folder.path)
    _filled(arena, tmp_path / "run", 3 * SLAB_ROWS + 5, [])
    for _ in range(3):
        assert arena.tried.acquire(timeout=30)
    link = folder.path / "pose_log.001.bin"
    if fault == "cut":
        with link.readlink().open("r+b") as file:
            file.truncate(5000)
        why = "5000 bytes: expected"
    else:
        link.unlink()
        link.symlink_to("/proc/self/mem")  # its first bytes cannot be read
        why = "Input/output error"
    log = PoseLog(of(folder.path))
    assert not log.unreadable
    rows = log.rows()
    lost = slice(SLAB_ROWS, 2 * SLAB_ROWS)
    assert (rows["status"][lost] == LOST).all() and (rows["publisher"][lost] == -1).all()
    assert (rows["source_stamp_ns"][lost] == SLAB_ROWS - 1).all()
    there = np.delete(rows["T_world_cam"][:, 0, 3], lost)
    assert there.tolist() == [*range(SLAB_ROWS), *range(2 * SLAB_ROWS, 3 * SLAB_ROWS + 5)]
    assert why in log.unreadable and f": {SLAB_ROWS} poses cannot be read" in log.unreadable
    assert log.unreadable.startswith(str(link.readlink()))
    assert log.rows_of_epoch(0) == range(3 * SLAB_ROWS + 5)


def test_the_writer_opens_no_rows_that_lie_on_the_disk(folder, tmp_path):
    """The disk hangs or is gone: here its files are, as soon as it has them."""
    arena = Arena(folder.path)
    disk = disk_folder(tmp_path / "run", folder.path)

    def move(name: str) -> None:
        arena.move_to_disk(name, disk)
        shutil.rmtree(disk)

    log = PoseLog(arena, move)
    for index in range(2 * SLAB_ROWS + 1):
        assert log.append(_row(index))
    assert not disk.exists() and (folder.path / "pose_log.001.bin").is_symlink()
