"""File work in a thread. A pipe without a writer, which a reader cannot open, is a disk that hangs."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hsslam_services.disk.disk_work import DiskWatch, DiskWork


@pytest.fixture
def pipe(tmp_path: Path) -> Iterator[Path]:
    os.mkfifo(tmp_path / "pipe")
    yield tmp_path / "pipe"
    os.close(os.open(tmp_path / "pipe", os.O_RDWR))  # no thread is left waiting


def _until(is_true) -> None:
    while not is_true():
        time.sleep(0.005)


def test_results_and_errors_are_those_of_the_work(tmp_path):
    disk = DiskWork()
    (tmp_path / "a").write_text("text")
    assert disk.do((tmp_path / "a").read_text) == "text"
    with pytest.raises(FileNotFoundError):
        disk.do((tmp_path / "b").read_text)
    assert disk.silent_s() == 0


def test_a_disk_that_hangs_costs_one_limited_wait_until_it_answers(pipe: Path):
    disk, done = DiskWork(), []
    begun_s = time.monotonic()
    with pytest.raises(TimeoutError, match="the disk does not answer for"):
        disk.do(pipe.read_text, 0.2)
    assert 0.2 <= time.monotonic() - begun_s < 1
    for _ in range(1000):  # at once, and without a queue that grows
        with pytest.raises(TimeoutError):
            disk.do(lambda: done.append(1), 0.1)
    assert time.monotonic() - begun_s < 1 and disk.silent_s() >= 0.2
    pipe.write_text("")
    _until(lambda: not disk.silent_s())
    assert disk.do(lambda: "answers") == "answers" and done == []


def test_a_loop_goes_on_while_the_disk_works(pipe: Path):
    disk, turns = DiskWork(), []

    def turn() -> None:
        turns.append(1)
        if len(turns) == 3:
            pipe.write_text("text")

    assert disk.do(pipe.read_text, 20.0, turn) == "text"
    assert len(turns) >= 3


def test_a_user_who_does_not_want_to_wait_ends_a_long_wait(pipe: Path):
    disk = DiskWork(hurried_s=0.3)
    disk.ask(pipe.read_text)
    begun_s = time.monotonic()
    with pytest.raises(TimeoutError, match="the disk does not answer for"):
        disk.do(lambda: None, 20.0, is_hurried=lambda: time.monotonic() > begun_s + 0.1)
    assert time.monotonic() - begun_s < 5


def test_work_of_a_loop_that_raises_is_not_done(pipe: Path):
    disk, done = DiskWork(), []
    read = disk.ask(pipe.read_text)
    with pytest.raises(ZeroDivisionError):
        disk.do(lambda: done.append(1), 20.0, lambda: 1 // 0)
    pipe.write_text("text")
    assert read.result(20) == "text"
    disk.do(lambda: None)
    assert done == []


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_has_ended_is_replaced():
    disk = DiskWork()
    with pytest.raises(TimeoutError):
        disk.do(sys.exit, 0.2)
    assert disk.do(lambda: "answers") == "answers"


def test_work_that_is_given_up_before_its_turn_is_not_done(pipe: Path):
    disk, done = DiskWork(), []
    read = disk.ask(pipe.read_text)
    with pytest.raises(TimeoutError):
        disk.do(lambda: done.append(1), 0.1)
    pipe.write_text("text")
    assert read.result(20) == "text"
    disk.do(lambda: None)
    assert done == []


def test_the_operator_is_told_once_that_the_disk_hangs_and_once_that_it_answers(pipe: Path):
    disk = DiskWork()
    watch = DiskWatch(disk, pipe.parent, patience_s=0.1)
    watch.tick()
    _until(lambda: not disk.silent_s())
    assert watch.news == []
    read = disk.ask(pipe.read_text)
    _until(lambda: disk.silent_s() > 0.1)
    for _ in range(3):
        watch.tick()
    pipe.write_text("")
    read.result(20)
    _until(lambda: not disk.silent_s())
    watch.tick()
    hangs, answers = watch.news
    assert hangs.startswith(f"{pipe.parent}: the disk does not answer for")
    assert answers == f"{pipe.parent}: the disk answers again"
