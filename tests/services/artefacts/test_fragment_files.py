"""Each fragment that ends without a join gets a file and a line; an error line if it cannot be saved."""

import os
import threading
from pathlib import Path

import pytest

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_services.artefacts import fragment_files
from hsslam_services.artefacts.fragment_files import FragmentFiles
from hsslam_services.artefacts.fragment_names import trajectory_beside
from tests.small_room import SMALL, room_frames, room_poses


def _fragment(number: int) -> Fragment:
    fragment = Fragment(SMALL, room_frames()[0], 0, number, 8)
    for frame, T in zip(room_frames()[:number], room_poses()[:number], strict=True):
        fragment.store.append(frame, T)
    return fragment


def test_each_fragment_has_a_file_and_a_line(tmp_path: Path):
    said: list[tuple[str, str]] = []
    files = FragmentFiles(tmp_path, SMALL, lambda level, text: said.append((level, text)))
    for number in (2, 3):
        files.save(_fragment(number))
    files.wait()
    names = {number: f"map_fragment_{number}.safetensors" for number in (2, 3)}
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names.values())
    for number, name in names.items():
        assert len(load_checkpoint(tmp_path / name).keyframe_stamps_ns) == number
    assert said == [
        ("info", f"fragment {number} has not joined the map: {name} has its {number} keyframes")
        for number, name in names.items()
    ]


def test_a_fragment_that_cannot_be_saved_costs_nothing_else(tmp_path: Path):
    said: list[tuple[str, str]] = []
    files = FragmentFiles(tmp_path / "no", SMALL, lambda level, text: said.append((level, text)))
    files.save(_fragment(1))
    files.wait()
    ((level, text),) = said
    path = tmp_path / "no" / "map_fragment_1.safetensors"
    assert level == "error"
    assert text.startswith(f"fragment 1 not saved: {path}: cannot write the map: ")
    assert files.failed == {1: text.removeprefix("fragment 1 not saved: ")}


def test_the_trajectory_beside_a_map_is_in_its_world(tmp_path: Path):
    for name in ("trajectory_fragment_1.epoch0.txt", "trajectory_fragment_10.txt"):
        (tmp_path / name).touch()
    of_map = {
        "map.safetensors": "trajectory.txt",
        "map_fragment_1.safetensors": "trajectory_fragment_1.epoch0.txt",
        "map_fragment_10.safetensors": "trajectory_fragment_10.txt",
        "map_fragment_2.safetensors": "trajectory_fragment_2.txt",
    }
    found = {name: trajectory_beside(tmp_path / name).name for name in of_map}
    assert found == of_map


def test_a_disk_that_hangs_holds_up_no_tracking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The write of fragment 1 does not return; as much memory is left as fragment 2 needs."""
    said, is_ending = [], threading.Event()
    files = FragmentFiles(tmp_path, SMALL, lambda *line: said.append(line), is_ending.is_set)
    fragments = {number: _fragment(number) for number in (1, 2, 3, 4)}
    monkeypatch.setattr(fragment_files, "MOST_BYTES", 3 * fragments[1].nbytes)
    hanging = tmp_path / "map_fragment_1.safetensors"
    os.mkfifo(hanging)  # opening it waits for a reader

    def end(number: int) -> bool:
        ended = threading.Thread(target=files.save, args=(fragments[number],), daemon=True)
        ended.start()
        ended.join(20)
        return not ended.is_alive()

    assert all(end(number) for number in (1, 2, 3))
    ((level, text),) = said
    assert level == "error"
    assert text.startswith("fragment 3 not saved: the disk is too slow or hangs: with those that ")
    assert "wait for it (1, 2) " in text
    is_ending.set()  # no fragment follows, so its memory is not needed
    assert end(4)
    assert hanging.read_bytes()
    files.wait()
    assert list(files.failed) == [3]
    for number in (2, 4):
        saved = load_checkpoint(tmp_path / f"map_fragment_{number}.safetensors")
        assert len(saved.keyframe_stamps_ns) == number


def test_where_the_camera_waits_a_fragment_waits_for_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """The write of fragment 1 does not return; the supervisor must see turns meanwhile."""
    said, turns = [], threading.Semaphore(0)

    def is_ending() -> bool:
        turns.release()
        return False

    files = FragmentFiles(
        tmp_path, SMALL, lambda *line: said.append(line), is_ending, waits_for_room=True
    )
    first, second = _fragment(1), _fragment(2)
    monkeypatch.setattr(fragment_files, "MOST_BYTES", first.nbytes + 1)
    hanging = tmp_path / "map_fragment_1.safetensors"
    os.mkfifo(hanging)  # opening it waits for a reader
    files.save(first)
    ended = threading.Thread(target=files.save, args=(second,), daemon=True)
    ended.start()
    assert all(turns.acquire(timeout=20) for _ in range(5))
    assert ended.is_alive() and not said
    assert hanging.read_bytes()
    ended.join(20)
    files.wait(20)
    assert not files.failed
    assert [level for level, _ in said] == ["info", "info"]
    saved = load_checkpoint(tmp_path / "map_fragment_2.safetensors")
    assert len(saved.keyframe_stamps_ns) == 2


@pytest.mark.parametrize("waits_for_room", [False, True])
def test_no_wait_for_a_disk_that_hangs_is_endless(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, waits_for_room: bool
):
    """The end of a run goes on without the fragments; those that are saved later are no loss."""
    said = []
    files = FragmentFiles(
        tmp_path, SMALL, lambda *line: said.append(line), waits_for_room=waits_for_room
    )
    first = _fragment(1)
    monkeypatch.setattr(fragment_files, "MOST_BYTES", first.nbytes + 1)
    monkeypatch.setattr(fragment_files, "MOST_SAVING_S", 0.5)
    hanging = tmp_path / "map_fragment_1.safetensors"
    os.mkfifo(hanging)  # opening it waits for a reader
    files.save(first)
    files.save(_fragment(2))
    assert list(files.failed) == [2] and "hangs" in files.failed[2]
    files.wait(0.1)
    assert list(files.failed) == [2, 1] and "hangs" in files.failed[1]
    assert [level for level, _ in said] == ["error", "error"]
    assert hanging.read_bytes()
    files.save(_fragment(3))
    files.wait(20.0)
    assert list(files.failed) == [2]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize("error", [OSError("the bus is closed"), SystemExit()])
def test_a_line_that_cannot_be_told_costs_no_fragment(tmp_path: Path, error: BaseException):
    """`SystemExit` ends even the thread: another one goes on."""

    def tell(*_: str) -> None:
        raise error

    files = FragmentFiles(tmp_path, SMALL, tell)
    fragments = [_fragment(number) for number in (1, 2, 3)]
    for fragment in fragments:
        files.save(fragment)
    waiting = threading.Thread(target=files.wait, daemon=True)
    waiting.start()
    waiting.join(20)
    assert not waiting.is_alive()
    for number in (1, 2, 3):
        assert load_checkpoint(tmp_path / f"map_fragment_{number}.safetensors")


@pytest.mark.parametrize("failures", [1, 2])
def test_a_fragment_is_saved_at_the_end_if_no_thread_can_start(
    failures: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    start, left = threading.Thread.start, failures * [RuntimeError("can't start new thread")]

    def start_later(thread: threading.Thread) -> None:
        if left:
            raise left.pop()
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", start_later)
    files = FragmentFiles(tmp_path, SMALL, lambda *_: None)
    files.save(_fragment(1))
    files.wait()
    assert load_checkpoint(tmp_path / "map_fragment_1.safetensors") and not files.failed
