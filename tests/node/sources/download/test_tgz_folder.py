"""Archives that are whole, damaged, or not to be trusted."""

import io
import os
import tarfile

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.download import tgz_folder
from hsslam_node.sources.download.tgz_folder import unpack_tgz


def packed(path, *members: tuple[str, bytes]) -> None:
    with tarfile.open(path, "w:gz") as archive:
        for name, content in members:
            member = tarfile.TarInfo(name)
            member.size = len(content)
            archive.addfile(member, io.BytesIO(content))


@pytest.fixture
def archive(tmp_path):
    path = tmp_path / "room.tgz"
    packed(path, ("room/rgb.txt", b"list"), ("room/rgb/0.png", os.urandom(100_000)))
    return path


def unpack(archive):
    unpack_tgz(archive, archive.parent / "room", lambda done, total: None)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_folder_is_there_and_nothing_else(archive):
    unpack(archive)
    assert (archive.parent / "room/rgb.txt").read_text() == "list"
    assert len((archive.parent / "room/rgb/0.png").read_bytes()) == 100_000
    assert names(archive.parent) == ["room", "room.tgz"]


@pytest.mark.parametrize("limit", ["_MOST_MEMBERS", "_MOST_BYTES"])
def test_an_archive_without_end_is_refused(archive, monkeypatch, limit):
    monkeypatch.setattr(tgz_folder, limit, 1)
    with pytest.raises(UserError, match="expected at most"):
        unpack(archive)
    assert names(archive.parent) == ["room.tgz"]


@pytest.mark.parametrize("spoil", ["cut", "checksum", "content", "no archive"])
def test_a_damaged_archive_is_told_and_removed(archive, spoil):
    data = bytearray(archive.read_bytes())
    if spoil == "cut":
        del data[60_000:]
    elif spoil == "checksum":
        data[-6] ^= 1
    elif spoil == "content":
        data[50_000] ^= 1
    else:
        data = bytearray(b"<html>try later</html>")
    archive.write_bytes(data)
    with pytest.raises(UserError, match=r"room\.tgz: damaged"):
        unpack(archive)
    assert names(archive.parent) == []


@pytest.mark.parametrize("name", ["../outside", "/outside", "room/../../outside"])
def test_nothing_is_written_elsewhere(tmp_path, name):
    inner = tmp_path / "inner"
    inner.mkdir()
    packed(inner / "room.tgz", ("room/rgb.txt", b"list"), (name, b"evil"))
    if name == "/outside":  # is put into the folder instead
        unpack(inner / "room.tgz")
        assert names(inner) == ["room", "room.tgz"]
    else:
        with pytest.raises(UserError, match="not safe to unpack"):
            unpack(inner / "room.tgz")
        assert names(inner) == ["room.tgz"]
    assert names(tmp_path) == ["inner"]


def test_another_folder_than_expected(tmp_path):
    packed(tmp_path / "room.tgz", ("kitchen/rgb.txt", b"list"))
    with pytest.raises(UserError, match="holds kitchen: expected a folder room"):
        unpack(tmp_path / "room.tgz")
    assert names(tmp_path) == ["room.tgz"]
