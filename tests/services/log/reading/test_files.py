"""Logs as they are found: whole, torn, growing, or no logs at all; `test_parted_log.py` has their parts."""

import errno
import fcntl
import os
import re
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from mcap.reader import make_reader

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_services.arena.arena_folder import SHM_ROOT, ArenaFolder
from hsslam_services.commands.log.command import main
from hsslam_services.commands.log.trim import trim
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.parted_log import PartedLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import log_reader
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from tests.services.log.sample_log import write_poses
from tests.services.wire_samples import pose


def test_an_unfinished_log_is_recovered_and_told_in_a_line(tmp_path):
    path = write_poses(tmp_path, 40)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    told: list[str] = []
    (file,) = log_parts(tmp_path, told.append)
    assert is_finished(file)
    assert len(told) == 1 and "recovered" in told[0] and "\n" not in told[0]
    with file.open("rb") as stream:
        metadata = list(make_reader(stream).iter_metadata())
    assert [(record.name, record.metadata) for record in metadata] == [("hsslam.run", {"a": "b"})]
    log_parts(path, told.append)
    assert len(told) == 1


def test_an_empty_file_without_the_name_of_a_log_is_left_alone(tmp_path):
    notes, log = tmp_path / "notes.txt", tmp_path / "new.mcap"
    for path in (notes, log):
        path.touch()
    with pytest.raises(UserError, match=r"notes\.txt: not an MCAP file"):
        log_parts(notes, print)
    assert notes.read_bytes() == b""
    assert log_parts(log, print) == [log]


@contextmanager
def _without_rights_of_root() -> Iterator[None]:
    own = os.geteuid()
    if own == 0:
        os.seteuid(54321)
    try:
        yield
    finally:
        os.seteuid(own)


def test_a_log_of_another_user_is_one_line(tmp_path, capsys):
    path = write_poses(tmp_path, 4)
    tmp_path.chmod(0)
    with _without_rights_of_root():
        for place in (tmp_path, path):
            assert main(["info", str(place)]) == 2
            told = capsys.readouterr().err
            assert re.fullmatch(rf"error: {place}: Permission denied: expected .*\n", told)
    tmp_path.chmod(0o700)
    assert main(["info", "x" * 300]) == 2
    assert "File name too long" in capsys.readouterr().err


def test_an_unfinished_log_that_this_user_may_only_read_is_said_to_lack_its_end():
    with tempfile.TemporaryDirectory() as folder:  # others may enter it
        path = write_poses(Path(folder), 4)
        path.write_bytes(path.read_bytes()[:-40])
        path.chmod(0o444)
        Path(folder).chmod(0o555)
        with (
            _without_rights_of_root(),
            pytest.raises(
                UserError, match=r"its end is missing, and this user may not complete it"
            ),
        ):
            log_parts(path, print)
        Path(folder).chmod(0o755)


def test_a_log_that_is_being_written_is_left_alone(tmp_path):
    log = PartedLog(tmp_path, "r")
    log.write(topics.POSE, encode(topics.POSE, pose(0)), 1, 1, 0)
    log._part._flushed_s = 0.0
    log.tick()
    before = log.path.read_bytes()
    with pytest.raises(UserError, match="still writing"):
        log_parts(log.path, print)
    assert log.path.read_bytes() == before
    log.close()
    assert log_parts(log.path, print) == [log.path]


def test_a_part_that_is_removed_before_it_is_read_is_one_line(tmp_path):
    with (
        pytest.raises(UserError, match=r"run\.1\.mcap: no such file: expected a part that"),
        log_reader(tmp_path / "run.1.mcap"),
    ):
        pass


def test_a_log_that_is_being_copied_is_left_alone(tmp_path):
    """The copy goes on while the log is opened; it has no lock."""
    whole = write_poses(tmp_path, 40).read_bytes()
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(whole[: len(whole) // 2])
    opened = threading.Event()

    def go_on() -> None:
        with copy.open("ab", buffering=0) as stream:
            for k in range(len(whole) // 2, len(whole)):
                stream.write(whole[k : k + 1])
                if opened.wait(0.05):
                    break
            stream.write(whole[k + 1 :])

    other = threading.Thread(target=go_on)
    other.start()
    try:
        with pytest.raises(UserError, match=r"copy\.mcap: another program is writing it: expected"):
            log_parts(copy, print)
    finally:
        opened.set()
        other.join()
    assert copy.read_bytes() == whole
    assert log_parts(copy, print) == [copy]


def test_without_locks_an_unfinished_log_is_left_alone_while_its_run_lives(
    tmp_path, monkeypatch, capsys
):
    path = write_poses(tmp_path, 40)
    path.write_bytes(path.read_bytes()[:-50])
    before, lock = path.read_bytes(), fcntl.flock

    def flock(fd: int, how: int) -> None:
        if Path(f"/proc/self/fd/{fd}").readlink().is_relative_to(SHM_ROOT):
            lock(fd, how)
        else:
            raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    arena = ArenaFolder(f"test-{os.getpid()}-locks", tmp_path)
    try:
        run = RunInfo(
            run_id="x",
            run_dir=str(tmp_path),
            arena_dir=str(arena.path),
            endpoint="",
            robot="r",
            supervisor_pid=os.getpid(),
            started_ns=1,
            options=ServeOptions(),
        )
        run.write()
        run.write_into_arena()
        for command in ("info", "recover"):
            assert main([command, str(path)]) == 2
            assert "a run is still writing it" in capsys.readouterr().err
        assert path.read_bytes() == before
    finally:
        arena.remove()
    assert main(["info", str(path)]) == 0
    assert is_finished(path)


@pytest.mark.parametrize("content", [b"no log at all", b"\x00" * 100])
def test_a_file_that_is_no_log_is_refused_and_kept(tmp_path, content):
    path = tmp_path / "picture.mcap"
    path.write_bytes(content)
    with pytest.raises(UserError, match="not an MCAP file"):
        log_parts(path, print)
    assert path.read_bytes() == content


@pytest.mark.parametrize(("place", "expected"), [("none.mcap", "No such file"), (".", "no log")])
def test_where_there_is_no_log_it_is_one_line(tmp_path, place, expected):
    with pytest.raises(UserError, match=expected):
        log_parts(tmp_path / place, print)


def test_a_first_part_without_messages_is_left_out(tmp_path, capsys):
    path = write_poses(tmp_path, 40)
    second = path.rename(tmp_path / "run.1.mcap")
    path.write_bytes(second.read_bytes()[:8])
    assert log_parts(path, print) == [path]
    files = log_parts(tmp_path, print)
    assert files == [second]
    short = tmp_path / "short.mcap"
    assert trim(files, short, 20e-9, 30e-9) == 10
    with short.open("rb") as stream:
        assert [record.metadata for record in make_reader(stream).iter_metadata()] == [{"a": "b"}]
