"""Each fragment that ends without a join gets a file and a line; an error line if it cannot be saved."""

import threading
from pathlib import Path

import pytest

from hsslam_node.fragments.fragment import Fragment
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_services.artefacts import fragment_files
from hsslam_services.artefacts.fragment_files import FragmentFiles
from hsslam_services.artefacts.fragment_names import trajectory_beside
from tests.small_room import SMALL, room_frames, room_poses
from tests.until import until


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


def test_once_the_run_ends_a_slow_disk_takes_no_turns_of_the_tracker(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Each turn would give the tracker more time to end; two fragments wait for the disk."""
    disk_is_free, turns = threading.Event(), []
    monkeypatch.setattr(fragment_files, "save_checkpoint", lambda *_: disk_is_free.wait(60))
    monkeypatch.setattr(fragment_files, "_TURN_S", 0.01)

    def should_stop() -> bool:
        turns.append(len(turns))
        return len(turns) == 5

    files = FragmentFiles(tmp_path, SMALL, lambda *_: None, should_stop)
    files.save(_fragment(1))
    second = threading.Thread(target=files.save, args=(_fragment(2),))
    second.start()
    until(lambda: len(turns) == 5, 30)
    second.join(0.2)
    assert len(turns) == 5 and second.is_alive()
    disk_is_free.set()
    second.join()
    files.wait()
