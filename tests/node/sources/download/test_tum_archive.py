"""Published sequences that are not on disk: fetched, unpacked, opened."""

import io
import os
import tarfile

import pytest

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.download import resumed_file
from hsslam_node.sources.download.tum_archive import TumArchive
from hsslam_node.sources.open_source import open_source

DESK = "rgbd_dataset_freiburg1_desk"


@pytest.fixture
def archive(tum_folder) -> bytes:
    (tum_folder / "filling").write_bytes(os.urandom(400_000))
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:gz") as file:
        file.add(tum_folder, DESK)
    return data.getvalue()


def test_a_sequence_is_fetched_once_and_goes_on_where_it_broke_off(
    archive, serve_files, monkeypatch, tmp_path, capsys
):
    server = serve_files({f"/freiburg1/{DESK}.tgz": archive}, breaks=[150_000, 150_000])
    monkeypatch.setattr(resumed_file, "_PAUSES_S", (0.0, 0.0))
    monkeypatch.setenv("HSSLAM_TUM_URL", server.url)
    monkeypatch.delenv("HSSLAM_DATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for _ in range(2):
        frames = list(open_source("tum:fr1/desk").frames())
        assert len(frames) == 5 and all(isinstance(frame, Frame) for frame in frames)
    assert [wanted for _, wanted in server.asked] == [None, "bytes=150000-", "bytes=300000-"]
    place = tmp_path / "cache/hsslam/sequences"
    assert [path.name for path in place.iterdir()] == [DESK]
    said = capsys.readouterr().err
    assert f"fetching {server.url}/freiburg1/{DESK}.tgz to {place}" in said


def test_an_archive_put_there_by_hand_needs_no_network(archive, monkeypatch, tmp_path):
    monkeypatch.setenv("HSSLAM_DATA", str(tmp_path / "data"))
    (tmp_path / "data").mkdir()
    (tmp_path / f"data/{DESK}.tgz").write_bytes(archive)
    assert open_source("tum:fr1/desk").frame_count == 5
    assert [path.name for path in (tmp_path / "data").iterdir()] == [DESK]


def test_names_lead_to_the_published_addresses(monkeypatch):
    monkeypatch.delenv("HSSLAM_TUM_URL")
    site = "https://cvg.cit.tum.de/rgbd/dataset"
    for name, file in (
        ("fr1/desk", "freiburg1/rgbd_dataset_freiburg1_desk"),
        ("fr2/xyz", "freiburg2/rgbd_dataset_freiburg2_xyz"),
        ("fr3/office", "freiburg3/rgbd_dataset_freiburg3_long_office_household"),
    ):
        archive = TumArchive.named(name)
        assert archive is not None and archive.url == f"{site}/{file}.tgz"
    assert TumArchive.named("kitchen") is None
    assert TumArchive.named("fr4/desk") is None


def test_without_a_network_it_says_what_to_do_by_hand(monkeypatch, tmp_path):
    monkeypatch.setenv("HSSLAM_DATA", str(tmp_path))
    with pytest.raises(UserError) as error:
        open_source("tum:fr3/office")
    name = "rgbd_dataset_freiburg3_long_office_household"
    url = f"{os.environ['HSSLAM_TUM_URL']}/freiburg3/{name}.tgz"
    assert str(error.value) == (
        f"source tum:fr3/office: {url}: Connection refused; by hand: put that file in {tmp_path}, "
        "or unpack it there"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_is_not_published_suggests_one(serve_files, monkeypatch, tmp_path):
    monkeypatch.setenv("HSSLAM_TUM_URL", serve_files({}).url)
    monkeypatch.setenv("HSSLAM_DATA", str(tmp_path))
    with pytest.raises(UserError, match=r"404 Not Found; did you mean fr1/desk\?"):
        open_source("tum:fr1/desc")


def test_a_folder_that_cannot_be_written_is_named(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("HSSLAM_DATA", str(tmp_path / "file"))
    with pytest.raises(UserError, match="set HSSLAM_DATA"):
        open_source("tum:fr1/desk")
