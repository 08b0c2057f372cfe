"""A supervised process that has exited: why, and whether it is started again."""

import dataclasses
import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.child import Child
from hsslam_services.run.run_info import RunInfo
from tests.services.launch.conftest import SPEC


def test_crash_loop_is_given_up(watch):
    start, until = watch
    child = start("crash", longest_delay_s=0.1)
    until(lambda: child.state == "failed", timeout_s=30)
    assert child.restarts == 5
    assert "given up" in child.news[-1]


def test_bad_input_is_not_tried_again(watch):
    start, until = watch
    child = start("bad input")
    until(lambda: child.state == "failed")
    assert child.user_error == "field = 3: expected 4"
    assert child.restarts == 0


def test_bad_input_in_a_run_that_works_is_tried_again(watch, run_info: RunInfo):
    start, until = watch
    child = start("bad input", may_pass=True)
    until(lambda: child.restarts == 1)
    assert "field = 3: expected 4: restart" in child.news[0]
    (run_info.path / "behaviour").write_text("obedient")
    until(lambda: child.state == "running")
    assert child.user_error == ""


@pytest.mark.parametrize(
    ("behaviour", "restarts"), [("no memory", 1), ("full GPU", 1), ("bad input", 0)]
)
def test_what_reads_the_source_is_tried_again_if_it_lacked_memory_alone(
    watch, behaviour: str, restarts: int
):
    start, until = watch
    child = start(behaviour, may_pass=True, reads_source=True)
    until(lambda: child.restarts or child.state == "failed")
    assert child.restarts == restarts
    if behaviour == "full GPU":
        told = "GPU memory is full: expected 20.00 MiB more free, or --device cpu"
        assert child.news[0].startswith(f"sample_worker ended: {told}: restart")


@contextmanager
def _hanging(disk: DiskWork, folder: Path) -> Iterator[None]:
    """The disk does not answer in the block: it opens a pipe without a writer, which a reader cannot open."""
    pipe = folder / "pipe"
    os.mkfifo(pipe)
    disk.ask(pipe.read_text)
    try:
        yield
    finally:
        pipe.write_text("")


def test_what_lacked_memory_is_tried_again_though_a_slow_disk_gives_the_reason_late(
    watch, run_info: RunInfo
):
    start, until = watch
    disk = DiskWork()
    child = start("no memory", may_pass=True, reads_source=True, disk=disk)
    until(lambda: child.is_alive)
    first = child.pid
    with _hanging(disk, run_info.path):
        until(lambda: not Path(f"/proc/{first}").exists() and disk.silent_s() > 1.1)
        assert (child.state == "failed", child.restarts) == (False, 0)
    until(lambda: child.restarts or child.state == "failed")
    assert child.restarts == 1
    assert child.news[0].startswith("sample_worker ended: array x: needs 8 bytes")


def test_what_ends_for_a_reason_that_the_disk_never_gives_is_tried_again(
    watch, run_info: RunInfo, monkeypatch: pytest.MonkeyPatch
):
    start, until = watch
    monkeypatch.setattr("hsslam_services.launch.child._RESULT_S", 0.2)
    disk = DiskWork()
    child = start("bad input", may_pass=True, reads_source=True, disk=disk)
    until(lambda: child.is_alive)
    first = child.pid
    with _hanging(disk, run_info.path):
        until(lambda: not Path(f"/proc/{first}").exists())
        (run_info.path / "behaviour").write_text("obedient")
        until(lambda: child.restarts == 1 and child.state == "running")


def test_an_unexpected_error_is_told_in_one_line(watch, run_info: RunInfo):
    start, until = watch
    bus = Bus(run_info.endpoint, run_info.robot, "reader")
    events, texts = bus.subscribe(topics.EVENT, 4), []
    start("faulty")
    until(lambda: texts.extend(event.text for event in events.drain()) or texts)
    assert texts[0] == "ValueError: text of a plugin in two lines; the traceback is in its log"
    bus.close()
    log = run_info.path / "logs" / "sample_worker.log"
    until(lambda: "in two lines" in log.read_text() and "Traceback" in log.read_text())


@pytest.mark.parametrize("has_ended", [True, False])
def test_exit_code_0_is_the_end_only_if_the_source_has_ended(watch, run_info: RunInfo, has_ended):
    """A driver may end the process of a camera."""
    start, until = watch
    child = start("exit 0", may_finish=True, has_source_ended=lambda: has_ended)
    until(lambda: child.state == "ended" if has_ended else child.restarts)
    assert child.restarts == (0 if has_ended else 1)
    if not has_ended:
        assert "exited with code 0 before the end of its source: restart in" in child.news[0]
        (run_info.path / "behaviour").write_text("obedient")
        until(lambda: child.state == "running")


def test_a_process_that_the_kernel_kills_for_lack_of_memory_is_said_to(watch, run_info: RunInfo):
    start, until = watch
    group = Path("/sys/fs/cgroup/memory") / f"hsslam-test-{os.getpid()}"
    try:
        group.mkdir()
    except OSError:
        pytest.skip("this machine does not allow memory control groups (version 1)")
    try:
        (group / "memory.limit_in_bytes").write_text("300M")
        (run_info.path / "control_group").write_text(str(group / "cgroup.procs"))
        child = start("too large")
        until(lambda: child.news, timeout_s=30.0)
        assert "was killed by SIGKILL, out of memory (in a container: --memory)" in child.news[0]
        (run_info.path / "behaviour").write_text("obedient")
        until(lambda: child.state == "running")
        child.kill()
    finally:
        _remove_group(group)


def _remove_group(group: Path) -> None:
    deadline_s = time.monotonic() + 10
    while (group / "cgroup.procs").read_text() and time.monotonic() < deadline_s:
        time.sleep(0.01)
    group.rmdir()


def test_a_crash_after_it_was_told_to_end_is_told(watch):
    start, until = watch
    child = start("crash at its end")
    until(lambda: child.state == "running")
    child.wanted = False
    until(lambda: child.state == "ended")
    assert child.news == ["sample_worker was killed by SIGABRT while it ended"]
    assert child.exit_code == -signal.SIGABRT


def test_a_process_that_the_system_does_not_start_counts_as_a_failed_start(tmp_path: Path):
    spec = dataclasses.replace(SPEC, first_delay_s=0.0, longest_delay_s=0.0)
    (tmp_path / "logs").write_text("no folder")  # its log cannot be opened
    child = Child(spec, tmp_path)
    child.wanted = True
    for _ in range(10):
        child.tick()
    assert child.state == "failed"
    assert child.restarts == 5
    assert "cannot be started" in child.news[0] and "given up" in child.news[-1]
