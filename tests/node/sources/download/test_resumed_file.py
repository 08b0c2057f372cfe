"""Downloads from a server that breaks off."""

import fcntl

import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.download import resumed_file
from hsslam_node.sources.download.resumed_file import download

DATA = np.random.default_rng(0).bytes(3_000_000)


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch):
    monkeypatch.setattr(resumed_file, "_PAUSES_S", (0.0, 0.0, 0.0))


def fetch(server, folder, reports=None, **options):
    said = [] if reports is None else reports
    target = folder / "file.tgz"
    download(f"{server.url}/file", target, lambda *counts: said.append(counts), **options)
    assert sorted(path.name for path in folder.iterdir()) == ["file.tgz"]
    return target.read_bytes()


def test_a_file_that_comes_at_once(serve_files, tmp_path):
    server = serve_files({"/file": DATA})
    reports = []
    assert fetch(server, tmp_path, reports) == DATA
    assert server.asked == [("/file", None)]
    assert reports[0] == (0, len(DATA)) and reports[-1] == (len(DATA), len(DATA))
    assert [done for done, _ in reports] == sorted(done for done, _ in reports)


def test_what_breaks_off_is_gone_on_from(serve_files, tmp_path):
    server = serve_files({"/file": DATA}, breaks=[1_000_001, 7, 1_500_000])
    assert fetch(server, tmp_path) == DATA
    ranges = [wanted for _, wanted in server.asked]
    assert ranges == [None, "bytes=1000001-", "bytes=1000008-", "bytes=2500008-"]


def test_a_part_of_an_earlier_try_is_gone_on_from(serve_files, tmp_path):
    server = serve_files({"/file": DATA})
    (tmp_path / "file.tgz.part").write_bytes(DATA[:2_000_000])
    assert fetch(server, tmp_path) == DATA
    assert server.asked == [("/file", "bytes=2000000-")]


def test_a_part_that_is_already_all_of_it_or_more(serve_files, tmp_path):
    server = serve_files({"/file": DATA})
    (tmp_path / "file.tgz.part").write_bytes(DATA)
    assert fetch(server, tmp_path) == DATA
    (tmp_path / "file.tgz").unlink()
    (tmp_path / "file.tgz.part").write_bytes(DATA + b"of another file")
    assert fetch(server, tmp_path) == DATA


def test_a_server_that_cannot_go_on_sends_it_anew(serve_files, tmp_path):
    server = serve_files({"/file": DATA}, breaks=[500], knows_ranges=False)
    assert fetch(server, tmp_path) == DATA
    assert len(server.asked) == 2


def test_one_that_always_breaks_off_at_the_same_place_is_given_up(serve_files, tmp_path):
    server = serve_files({"/file": DATA}, breaks=[1000] + 9 * [0])
    with pytest.raises(UserError, match="connection lost at 1000 bytes, which are kept"):
        fetch(server, tmp_path)
    assert (tmp_path / "file.tgz.part").read_bytes() == DATA[:1000]
    server.breaks.clear()
    assert fetch(server, tmp_path) == DATA


@pytest.mark.parametrize(("status", "words"), [(403, "403 Forbidden"), (503, "503 Service")])
def test_a_refusal_is_told_and_leaves_nothing(serve_files, tmp_path, status, words):
    server = serve_files({"/file": DATA}, status=status)
    with pytest.raises(UserError, match=words) as error:
        fetch(server, tmp_path)
    assert server.url in str(error.value)
    assert list(tmp_path.iterdir()) == []


def test_nobody_there(tmp_path):
    with pytest.raises(UserError, match=r"http://127.0.0.1:9/x: Connection refused"):
        download("http://127.0.0.1:9/x", tmp_path / "x", print)
    with pytest.raises(UserError, match="expected an address that begins with https"):
        download("file:///etc/hostname", tmp_path / "x", print)


def test_room_on_the_disk_is_asked_for_first(serve_files, tmp_path):
    server = serve_files({"/file": DATA})
    with pytest.raises(UserError, match="MB needed in"):
        fetch(server, tmp_path, room_factor=1e12)


def test_two_at_once_are_told(serve_files, tmp_path):
    server = serve_files({"/file": DATA})
    with (tmp_path / "file.tgz.part").open("ab") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(UserError, match="another process is downloading it"):
            fetch(server, tmp_path)
