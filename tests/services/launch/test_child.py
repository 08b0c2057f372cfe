"""A supervised process, in the flesh: beats, restarts, gives up, ends in order or by force."""

import dataclasses
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_proto.request_messages import QueryMap
from hsslam_proto.requests import QUERY
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.child import Child
from hsslam_services.launch.fork_client import ForkedProcess
from hsslam_services.launch.process_table import ProcessSpec
from hsslam_services.launch.spawn import Spawn, log_path, spawn
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL

_SPEC = ProcessSpec(
    "sample_worker",
    "tests.services.sample_worker",
    "a test",
    nice=0,
    stop_stage=1,
    first_delay_s=0.1,
)


@pytest.fixture
def watch(run_info: RunInfo):
    """Start a sample with a behaviour; returns it and a function that ticks until a condition."""
    bus = Bus(run_info.endpoint, run_info.robot, "supervisor")
    health = bus.subscribe(topics.HEALTH, 16)
    children: list[Child] = []

    def start(
        behaviour: str,
        *,
        may_pass: bool = False,
        has_source_ended: Callable[[], bool] = lambda: True,
        by: Spawn = spawn,
        disk: DiskWork | None = None,
        **fields: float,
    ) -> Child:
        (run_info.path / "behaviour").write_text(behaviour)
        spec = dataclasses.replace(_SPEC, **fields)
        child = Child(spec, run_info.path, by, lambda: may_pass, has_source_ended, disk)
        child.wanted = True
        children.append(child)
        return child

    def until(condition: Callable[[], object], timeout_s: float = 10.0) -> None:
        deadline = time.monotonic() + timeout_s
        while not condition():
            assert time.monotonic() < deadline, [c.state for c in children]
            for message in health.drain():
                children[-1].heard(message)
            children[-1].tick()
            time.sleep(0.01)

    yield start, until
    for child in children:
        child.kill()
    bus.close()


def test_runs_restarts_after_a_kill_and_ends_in_order(watch, run_info: RunInfo):
    start, until = watch
    child = start("obedient")
    until(lambda: child.state == "running")
    assert child.health.counters["laps"] == 1
    first = child.pid
    os.kill(first, signal.SIGKILL)
    until(lambda: child.state == "running" and child.pid != first)
    assert child.restarts == 1
    assert "SIGKILL" in child.news[0]
    child.wanted = False
    until(lambda: child.state == "ended")
    assert (run_info.path / "ended").read_text() == "in order"


def test_while_the_disk_hangs_processes_are_restarted_without_their_log(watch, run_info: RunInfo):
    """A pipe without a reader, which a writer cannot open, is a disk that hangs."""
    start, until = watch
    disk = DiskWork()
    child = start("obedient", by=partial(spawn, disk=disk), disk=disk)
    until(lambda: child.state == "running")
    log = log_path(run_info.path, _SPEC.module)
    log.unlink()
    os.mkfifo(log)
    try:
        for _ in range(2):
            first = child.pid
            os.kill(first, signal.SIGKILL)
            until(lambda first=first: child.state == "running" and child.pid != first, 30.0)
    finally:
        os.close(os.open(log, os.O_RDWR))  # no thread is left waiting
    assert child.restarts == 2


def test_one_that_was_frozen_together_with_its_supervisor_is_not_killed(watch):
    start, until = watch
    child = start("obedient", health_timeout_s=1.0)
    until(lambda: child.state == "running")
    pid = child.pid
    os.kill(pid, signal.SIGSTOP)
    time.sleep(2.5)
    child.tick()
    os.kill(pid, signal.SIGCONT)
    begin_s = time.monotonic()
    until(lambda: time.monotonic() > begin_s + 0.7)
    assert (child.pid, child.restarts, child.news) == (pid, 0, [])


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


@pytest.mark.parametrize(
    ("disk", "text"),
    [
        ("full disk", "a line that its log has no room for"),
        ("hanging disk", "a line that its log never takes"),
    ],
)
def test_a_log_that_takes_no_line_holds_up_no_process(
    disk: str, text: str, watch, run_info: RunInfo
):
    start, until = watch
    bus = Bus(run_info.endpoint, run_info.robot, "reader")
    events = bus.subscribe(topics.EVENT, 4)
    child = start(disk)
    until(lambda: (run_info.path / "at_work").exists() and child.state == "running")
    until(lambda: [e.text for e in events.drain()] == [text])
    assert child.restarts == 0
    bus.close()


def test_frozen_process_is_replaced(watch):
    start, until = watch
    child = start("obedient", health_timeout_s=2.0)
    until(lambda: child.state == "running")
    os.kill(child.pid, signal.SIGSTOP)
    until(lambda: child.restarts == 1)
    assert "no heartbeat" in child.news[0]


@pytest.mark.alone
def test_a_process_that_gets_no_core_on_a_busy_machine_is_not_killed(watch):
    start, until = watch
    child = start("starved", health_timeout_s=1.0)
    told = "sample_worker sends no heartbeat for 1 s: it waits for a core, as other programs use them all"
    until(lambda: told in child.news, timeout_s=30)
    pid, silent = child.pid, child.health
    until(lambda: child.health is not silent and child.state == "running", timeout_s=30)
    assert (child.pid, child.restarts, child.news) == (pid, 0, [told])


@pytest.mark.alone
def test_a_process_that_gets_no_core_has_longer_to_end(watch, run_info: RunInfo):
    start, until = watch
    child = start("starved", stop_timeout_s=1.0)
    until(lambda: (run_info.path / "at_work").exists())
    child.wanted = False
    until(lambda: not child.is_alive, timeout_s=30)
    assert (child.state, child.exit_code, child.news) == ("ended", 0, [])


def test_an_answer_that_takes_long_does_not_delay_the_end(watch, run_info: RunInfo):
    start, until = watch
    child = start("slow to answer", stop_timeout_s=8.0)
    until(lambda: child.state == "running")
    with Bus(run_info.endpoint, run_info.robot, "gateway") as bus:
        question = QueryMap(points=b"")
        threading.Thread(target=lambda: bus.pass_on(QUERY, question), daemon=True).start()
        until(lambda: (run_info.path / "asked").exists())
        child.wanted = False
        until(lambda: not child.is_alive)
    assert (child.state, child.exit_code, child.news) == ("ended", 0, [])


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


def test_one_that_a_slow_fork_server_does_not_start_is_started_without_it(watch, run_info: RunInfo):
    start, until = watch
    server, link = socket.socketpair()  # this server never answers

    def requested(module: str, run_dir: Path) -> ForkedProcess:
        return ForkedProcess(link, lambda: spawn(module, run_dir), patience_s=2.5)

    child = start("obedient", by=requested, startup_timeout_s=6.0)
    until(lambda: child.state == "running")
    assert child.restarts == 0
    server.close()


def test_loop_that_does_not_come_round_is_replaced(watch):
    start, until = watch
    child = start("stuck", stall_timeout_s=1.0)
    until(lambda: child.restarts == 1)
    assert "made no progress" in child.news[0]


def test_deaf_process_is_killed(watch):
    start, until = watch
    child = start("deaf", stop_timeout_s=1.0)
    until(lambda: child.state == "running")
    child.wanted = False
    until(lambda: child.state == "ended")
    assert "did not end" in child.news[-1]


def test_a_crash_after_it_was_told_to_end_is_told(watch):
    start, until = watch
    child = start("crash at its end")
    until(lambda: child.state == "running")
    child.wanted = False
    until(lambda: child.state == "ended")
    assert child.news == ["sample_worker was killed by SIGABRT while it ended"]
    assert child.exit_code == -signal.SIGABRT


def test_what_systemd_sends_to_all_processes_is_left_to_the_supervisor(watch):
    start, until = watch
    child = start("obedient")
    until(lambda: child.state == "running")
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        os.kill(child.pid, number)
    beats = {id(child.health): child.health}
    until(lambda: beats.setdefault(id(child.health), child.health) and len(beats) > 2)
    assert (child.state, child.restarts) == ("running", 0)


def test_ends_in_order_however_many_signals_come(watch, run_info: RunInfo):
    """As when its parent's death and the watchdog tell it within a microsecond."""
    start, until = watch
    child = start("obedient")
    until((run_info.path / "at_work").exists)
    for number in (END_SIGNAL, signal.SIGTERM, signal.SIGINT) * 1500:
        os.kill(child.pid, number)
    until((run_info.path / "ended").exists)


def test_a_process_that_the_system_does_not_start_counts_as_a_failed_start(tmp_path: Path):
    spec = dataclasses.replace(_SPEC, first_delay_s=0.0, longest_delay_s=0.0)
    (tmp_path / "logs").write_text("no folder")  # its log cannot be opened
    child = Child(spec, tmp_path)
    child.wanted = True
    for _ in range(10):
        child.tick()
    assert child.state == "failed"
    assert child.restarts == 5
    assert "cannot be started" in child.news[0] and "given up" in child.news[-1]
