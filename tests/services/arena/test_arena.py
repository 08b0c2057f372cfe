"""Shared arrays: re-attached by others, zero-filled, leased, refused where memory is short."""

import contextlib
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.errors import OutOfMemoryError, UserError
from hsslam_node.map.pose_log import POSE_ROW, PoseLog
from hsslam_services.arena.arena import Arena
from hsslam_services.arena.arena_folder import (
    ArenaFolder,
    disk_folder,
    foreign_arenas,
    kept_arenas,
    live_arenas,
    owned_after_death,
    owner_lives,
    remove_dead_arenas,
    try_own,
)
from hsslam_services.arena.arena_view import ArenaView
from hsslam_services.arena.process_registry import enter_process, living_processes
from hsslam_services.arena.unsaved_marker import mark_unsaved, read_unsaved

_POSE = np.dtype([("index", "<i8"), ("T", "<f8", (4, 4)), ("ok", "u1")])


@pytest.mark.parametrize(
    ("shape", "dtype"), [((3, 4), np.float32), ((5,), _POSE), ((), np.int64), ((0, 3), np.uint8)]
)
def test_reattached_array_is_the_same_memory(tmp_path: Path, shape, dtype):
    first = Arena(tmp_path).create("a", shape, dtype)
    assert first.shape == shape
    assert first.dtype == dtype
    assert not first.any() if first.dtype.names is None else not first["T"].any()
    first.reshape(-1).view(np.uint8)[...] = 7
    again = Arena(tmp_path).create("a", shape, dtype)
    assert again.dtype == first.dtype
    assert again.tobytes() == first.tobytes()


def test_other_shape_is_refused_and_absence_is_a_key_error(tmp_path: Path):
    arena = Arena(tmp_path)
    arena.create("a", (3,), np.float32)
    with pytest.raises(ValueError, match="array a is"):
        arena.create("a", (4,), np.float32)
    with pytest.raises(KeyError):
        arena.open("b")
    assert arena.exists("a")
    assert not arena.exists("b")


def test_a_removed_array_stays_with_those_who_use_it(tmp_path: Path):
    arena = Arena(tmp_path)
    array = arena.create("a", (3,), np.int64)
    array[:] = 5
    Arena(tmp_path).remove("a")
    arena.remove("a")
    with pytest.raises(KeyError):
        arena.open("a")
    assert (array == 5).all()
    assert arena.create("a", (2,), np.float32).tolist() == [0, 0]


@pytest.mark.parametrize("view", [Arena, ArenaView])
def test_an_array_that_is_removed_while_it_is_opened_is_a_key_error(tmp_path: Path, view):
    is_over = threading.Event()

    def replace_it() -> None:
        arena = Arena(tmp_path)
        while not is_over.is_set():
            arena.create("a", (8,), np.int64)
            arena.remove("a")

    mapper = threading.Thread(target=replace_it)
    mapper.start()
    try:
        until_s = time.monotonic() + 1.0
        while time.monotonic() < until_s:  # most turns find it, or not; some in between
            with contextlib.suppress(KeyError):
                view(tmp_path).open("a")
    finally:
        is_over.set()
        mapper.join()


def test_memory_survives_a_killed_writer_and_its_lease_is_freed(tmp_path: Path):
    code = (
        "import sys, time; from pathlib import Path; import numpy as np\n"
        "from hsslam_services.arena.arena import Arena\n"
        "arena = Arena(Path(sys.argv[1]))\n"
        "with arena.lease('params'):\n"
        "    arena.create('a', (4,), np.int64)[:] = 11\n"
        "    print('held', flush=True); time.sleep(60)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "held\n"
    child.send_signal(signal.SIGKILL)
    child.wait()
    with Arena(tmp_path).lease("params"):
        assert Arena(tmp_path).open("a").tolist() == [11] * 4


@pytest.fixture
def small_shm(tmp_path: Path):
    if os.geteuid() != 0:
        pytest.skip("mounting a small tmpfs needs root")
    root = tmp_path / "shm"
    root.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(root)]
    if subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("this machine does not allow mounts")
    yield root
    subprocess.run(["umount", "-l", str(root)], check=True)


def test_full_memory_names_the_bytes_and_leaves_nothing(small_shm: Path):
    folder = ArenaFolder("full", small_shm, root=small_shm)
    with pytest.raises(UserError, match="array params needs 4000000 bytes"):
        Arena(folder.path).create("params", (1_000_000,), np.float32)
    assert not Arena(folder.path).exists("params")
    assert not (folder.path / "params.bin").exists()
    Arena(folder.path).create("params", (1000,), np.float32)


def test_memory_that_is_full_but_for_the_data_is_told_as_such(small_shm: Path):
    """The last page goes to the data, and there is none for the header."""
    folder = ArenaFolder("full", small_shm, root=small_shm)
    free = os.statvfs(small_shm)
    with pytest.raises(
        OutOfMemoryError, match=rf"array params needs {(free.f_bavail) * 4096} bytes"
    ):
        Arena(folder.path).create("params", (free.f_bavail * 4096,), np.uint8)
    assert [path.name for path in folder.path.glob("params*")] == []
    Arena(folder.path).create("params", (1000,), np.float32)


def test_an_owner_lets_go_once(tmp_path: Path):
    folder = ArenaFolder("one", tmp_path, root=tmp_path)
    folder.remove()
    other = (tmp_path / "file").open("w")  # gets the number of the lock's descriptor
    folder.let_go()
    other.write("text")
    other.close()


def test_what_a_killed_process_left_on_disk_is_removed_too(tmp_path: Path):
    folder = ArenaFolder("one", tmp_path / "run", root=tmp_path)
    on_disk = disk_folder(tmp_path / "run", folder.path)
    arena = Arena(folder.path)
    arena.create("poses", (3,), np.int64)
    arena.move_to_disk("poses", on_disk)
    (on_disk / ".hsslam-12.partial.bin").write_bytes(b"half")
    folder.remove()
    assert not (tmp_path / "run" / ".arena").exists()


def test_a_limit_of_file_sizes_is_named(tmp_path: Path):
    folder = ArenaFolder("limited", tmp_path, root=tmp_path)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        with pytest.raises(UserError, match=r"array params needs 4000000 bytes .* \(ulimit -f\)$"):
            Arena(folder.path).create("params", (1_000_000,), np.float32)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not (folder.path / "params.bin").exists()


def test_folders_of_dead_owners_are_removed_and_of_living_ones_kept(tmp_path: Path):
    code = (
        "import sys, time; from pathlib import Path\n"
        "from hsslam_services.arena.arena_folder import ArenaFolder\n"
        "ArenaFolder('dead', Path('/x'), root=Path(sys.argv[1]))\n"
        "assert 'torch' not in sys.modules\n"
        "print('made', flush=True); time.sleep(60)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "made\n"
    mine = ArenaFolder("mine", Path("/y"), root=tmp_path)
    assert (mine.path.stat().st_mode & 0o777) == 0o700
    assert remove_dead_arenas(tmp_path) == []
    child.kill()
    child.wait()
    deadline = time.monotonic() + 5
    while (tmp_path / "hsslam-dead").exists() and time.monotonic() < deadline:
        remove_dead_arenas(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["hsslam-mine"]
    mine.remove()
    assert list(tmp_path.iterdir()) == []


def test_a_dead_folder_with_poses_or_marked_as_unsaved_is_not_removed(tmp_path: Path):
    run_dir = tmp_path / "gone"
    names = ("interrupted", "marked", "poses", "thrown")
    interrupted, marked, with_poses, thrown_away = arenas = [
        ArenaFolder(n, run_dir, root=tmp_path) for n in names
    ]
    for arena in (with_poses, interrupted):
        PoseLog(Arena(arena.path)).append(np.zeros((), POSE_ROW))
    mark_unsaved(marked.path, run_dir, ["map"])
    mark_unsaved(interrupted.path, run_dir, ["mesh"], is_being_saved=True)
    for arena in arenas:
        assert owner_lives(arena.path)
        arena.let_go()
    assert remove_dead_arenas(tmp_path) == [interrupted.path, with_poses.path]
    assert kept_arenas(tmp_path) == [marked.path]
    assert live_arenas(tmp_path) == []
    assert read_unsaved(marked.path) == (run_dir, ("map",), False)
    assert read_unsaved(interrupted.path) == (run_dir, ("mesh",), True)
    assert not thrown_away.path.exists()
    with owned_after_death(marked.path) as is_there, try_own(marked.path) as is_free:
        assert is_there and not is_free


def test_a_process_of_an_arena_is_known_by_its_start(tmp_path: Path):
    code = (
        "import sys, time\nfrom pathlib import Path\n"
        "from hsslam_services.arena.process_registry import enter_process\n"
        "enter_process(Path(sys.argv[1]), 'mapper'); print('entered', flush=True); time.sleep(60)\n"
    )
    child = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None and child.stdout.readline() == "entered\n"
    assert living_processes(tmp_path) == {child.pid: "mapper"}
    entry = tmp_path / "processes" / str(child.pid)
    ticks, name = entry.read_text().split()
    entry.write_text(f"{int(ticks) - 1} {name}")  # of one that had this id before
    assert living_processes(tmp_path) == {}
    child.kill()
    child.wait()


def test_a_process_that_cannot_be_entered_says_so(tmp_path: Path):
    enter_process(tmp_path / "gone", "mapper")  # the arena went with the supervisor
    (tmp_path / "processes").touch()
    with pytest.raises(OSError, match="processes"):
        enter_process(tmp_path, "mapper")


def test_links_and_folders_of_others_are_left_alone(tmp_path: Path):
    victim = tmp_path / "victim"
    (victim / "kept").mkdir(parents=True)
    (victim / "owner.lock").touch()
    root = tmp_path / "shm"
    root.mkdir()
    (root / "hsslam-link").symlink_to(victim)
    own = root / "hsslam-own"
    own.mkdir()
    (own / "owner.lock").symlink_to(victim / "owner.lock")
    foreign = [root / "hsslam-link"]
    if os.geteuid() == 0:  # only root can give a folder away
        foreign.insert(0, root / "hsslam-foreign")
        foreign[0].mkdir()
        (foreign[0] / "owner.lock").touch()
        os.chown(foreign[0], 65534, 65534)
    assert remove_dead_arenas(root) == live_arenas(root) == []
    assert foreign_arenas(root) == foreign
    assert (victim / "kept").is_dir()
    assert all(path.exists() for path in (own, *foreign))
