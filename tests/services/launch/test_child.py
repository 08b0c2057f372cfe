"""A supervised process: beats, restarts, ends in order or by force."""

import os
import signal
import socket
import threading
import time
from functools import partial
from pathlib import Path

import pytest

from hsslam_proto import topics
from hsslam_proto.request_messages import QueryMap
from hsslam_proto.requests import QUERY
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.launch.fork_client import ForkedProcess
from hsslam_services.launch.spawn import log_path, spawn
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL
from tests.services.launch.conftest import SPEC


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
    log = log_path(run_info.path, SPEC.module)
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
