"""Saved maps by their name, file or run folder."""

import pytest

from hsslam_node.errors import UserError
from hsslam_services.run.maps_folder import find_map, known_maps, map_path


def test_maps_have_names_not_paths(tmp_path):
    assert map_path(tmp_path, "room-1") == tmp_path / "room-1.safetensors"
    for name in ("", "a/b", "..", "a b", "x" * 65):
        with pytest.raises(UserError, match="expected a name"):
            map_path(tmp_path, name)
    map_path(tmp_path, "b").touch()
    (tmp_path / ".hsslam-1.partial.safetensors").touch()  # that a saver writes
    assert known_maps(tmp_path) == ["b"]
    assert known_maps(tmp_path / "none") == []
    assert find_map(tmp_path, "b") == find_map("elsewhere", str(tmp_path / "b.safetensors"))
    with pytest.raises(
        UserError, match=r"--map bb: no such map in .*did you mean b.; known maps: b"
    ):
        find_map(tmp_path, "bb")
    with pytest.raises(UserError, match=r"--map ./b: no such file"):
        find_map(tmp_path, "./b")


def test_a_run_folder_is_a_map(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs/desk").mkdir(parents=True)
    with pytest.raises(UserError, match=r"--map runs/desk/map.safetensors: no such file"):
        find_map("maps", "runs/desk/")
    saved = tmp_path / "runs/desk/map.safetensors"
    saved.touch()
    for given in ("runs/desk", "./runs/desk/", str(saved.parent)):
        assert find_map("maps", given) == saved
    monkeypatch.chdir(tmp_path / "runs")
    assert find_map("maps", "desk") == saved
    map_path("maps", "desk").parent.mkdir()
    map_path("maps", "desk").touch()
    assert find_map("maps", "desk") == map_path("maps", "desk")  # names first
