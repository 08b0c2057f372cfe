"""Files on a disk whose power is cut the moment after they are told as written."""

import numpy as np
import pytest
import trimesh

from hsslam_node.durable_file import durable_file, write_durably
from hsslam_node.geometry.trajectory import Trajectory, read_tum, write_tum


def test_what_was_written_is_whole_after_a_power_cut(disk):
    poses = np.tile(np.eye(4), (500, 1, 1))
    trajectory = Trajectory(np.arange(500) * 10**9, poses)
    content = np.random.default_rng(0).bytes(2**20)
    (disk.folder / "careless").write_bytes(content)
    write_durably(disk.folder / "written", content)
    write_tum(disk.folder / "trajectory.txt", trajectory)
    with durable_file(disk.folder / "mesh.ply") as partial:
        trimesh.creation.icosphere().export(partial)
    after = disk.cut()
    assert (after / "written").read_bytes() == content
    assert len(read_tum(after / "trajectory.txt")) == 500
    assert len(trimesh.load_mesh(after / "mesh.ply").faces) == 1280
    assert _size(after / "careless") < len(content)  # the cut is one


def test_a_power_cut_before_the_end_leaves_the_old_content(disk):
    path = disk.folder / "summary.json"
    write_durably(path, b"old")
    with durable_file(path) as partial:
        partial.write_bytes(b"new")
        assert (disk.cut() / "summary.json").read_bytes() == b"old"
    assert (disk.cut() / "summary.json").read_bytes() == b"new"


def test_what_fails_leaves_nothing_and_the_old_content(tmp_path):
    path = tmp_path / "map.bin"
    write_durably(path, b"old")
    with pytest.raises(RuntimeError), durable_file(path) as partial:
        partial.write_bytes(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert [found.name for found in tmp_path.iterdir()] == ["map.bin"]
    with pytest.raises(FileNotFoundError):
        write_durably(tmp_path / "none" / "file", b"")


def _size(path):
    return path.stat().st_size if path.exists() else 0
