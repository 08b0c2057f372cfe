"""Files on a disk whose power is cut the moment after they are told as written."""

import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import trimesh
from safetensors.numpy import save_file

from hsslam_node.durable_file import durable_file, write_durably
from hsslam_node.geometry.trajectory import Trajectory, read_tum, write_tum


def test_what_was_written_is_whole_after_a_power_cut(disk):
    poses = np.tile(np.eye(4), (500, 1, 1))
    trajectory = Trajectory(np.arange(500) * 10**9, poses)
    content = np.random.default_rng(0).bytes(2**20)
    (disk.folder / "careless").write_bytes(content)
    write_durably(disk.folder / "written", content)
    write_tum(disk.folder / "trajectory.txt", trajectory)
    with durable_file(disk.folder / "mesh.ply") as unfinished:
        trimesh.creation.icosphere().export(unfinished)
    after = disk.cut()
    assert (after / "written").read_bytes() == content
    assert len(read_tum(after / "trajectory.txt")) == 500
    assert len(trimesh.load_mesh(after / "mesh.ply").faces) == 1280
    assert _size(after / "careless") < len(content)  # the cut is one


def test_a_power_cut_before_the_end_leaves_the_old_content(disk):
    path = disk.folder / "summary.json"
    write_durably(path, b"old")
    with durable_file(path) as unfinished:
        unfinished.write_bytes(b"new")
        assert (disk.cut() / "summary.json").read_bytes() == b"old"
    assert (disk.cut() / "summary.json").read_bytes() == b"new"


def test_what_fails_leaves_nothing_and_the_old_content(tmp_path):
    path = tmp_path / "map.bin"
    write_durably(path, b"old")
    with pytest.raises(RuntimeError), durable_file(path) as unfinished:
        unfinished.write_bytes(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"old"
    assert [found.name for found in tmp_path.iterdir()] == ["map.bin"]
    with pytest.raises(FileNotFoundError):
        write_durably(tmp_path / "none" / "file", b"")


def test_threads_may_write_the_same_file_at_once(tmp_path):
    path = tmp_path / "map.bin"
    contents = [bytes([k]) * 2**20 for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(partial(write_durably, path), contents))
    assert path.read_bytes() in contents
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["n" * 255, "n" * 240 + ".json"])
def test_a_name_may_be_as_long_as_the_file_system_allows(tmp_path, name: str):
    write_durably(tmp_path / name, b"content")
    assert (tmp_path / name).read_bytes() == b"content"


def test_permissions_stay_and_those_of_a_new_file_follow_the_umask(tmp_path):
    def save(path: Path) -> int:
        with durable_file(path) as unfinished:
            save_file({"a": np.zeros(1)}, unfinished)  # of safetensors: 0600 whatever the umask is
        return path.stat().st_mode & 0o777

    path, before = tmp_path / "map.safetensors", os.umask(0o027)
    try:
        assert save(path) == 0o640
        path.chmod(0o664)
        assert save(path) == 0o664
    finally:
        os.umask(before)


@pytest.mark.parametrize("name", ["/", "a\0b"])
def test_what_is_no_name_of_a_file_is_an_error_of_the_system(name: str):
    with pytest.raises(OSError):
        write_durably(name, b"")


def test_a_link_stays_and_its_file_is_replaced(tmp_path):
    (tmp_path / "real").mkdir()
    link = tmp_path / "link.json"
    link.symlink_to("real/file.json")
    for content in (b"first", b"second"):  # at first the link names no file
        write_durably(link, content)
        assert link.is_symlink() and (tmp_path / "real/file.json").read_bytes() == content


def test_a_pipe_gets_the_content_and_stays(tmp_path):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    with ThreadPoolExecutor(1) as reader:
        read = reader.submit(pipe.read_bytes)
        write_durably(pipe, b"content")
        assert read.result(20) == b"content"
    assert pipe.is_fifo()


@pytest.mark.parametrize("is_file", [False, True])
def test_standard_output_gets_the_content_behind_what_came_before(tmp_path, is_file):
    code = (
        "import sys; from hsslam_node.durable_file import write_durably as write; "
        "print('first', flush=True); write('/dev/stdout', b'content\\n'); print('last')"
    )
    out = tmp_path / "out.txt"
    with out.open("wb") as stream:
        done = subprocess.run(
            [sys.executable, "-c", code], stdout=stream if is_file else subprocess.PIPE, check=True
        )
    lines = out.read_bytes() if is_file else done.stdout
    assert lines.split() == [b"first", b"content", b"last"]


def _size(path):
    return path.stat().st_size if path.exists() else 0


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    """Not the temporary one."""
    for path in (tmp_path / "no" / "t.txt", tmp_path / "file" / "t.txt", tmp_path / "folder"):
        (tmp_path / "folder").mkdir(exist_ok=True)
        (tmp_path / "file").touch()
        with pytest.raises(OSError, match=re.escape(f"'{path}'") + "$"):
            write_durably(path, b"new")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "folder"]


def test_a_folder_is_refused_before_anything_is_written(tmp_path):
    with pytest.raises(IsADirectoryError), durable_file(tmp_path):
        pytest.fail("the block runs")
