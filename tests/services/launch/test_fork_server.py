"""Forked processes are as good as fresh ones, and the fork server may die."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import psutil
import pytest

from hsslam_node.presets import PRESETS
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.launch.spawn import Process
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL
from tests.caught_signals import catches
from tests.services.conftest import run_maker, started_fork_server

_SAMPLE = "tests.services.sample_worker"


@pytest.fixture(scope="module")
def living_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunInfo]:
    with run_maker(tmp_path_factory.mktemp("living")) as make:
        yield make(slam=PRESETS["realtime"])


@pytest.fixture(scope="module")
def living_client(living_run: RunInfo) -> Iterator[ForkClient]:
    """Of a fork server that no test kills, because a start takes seconds."""
    with started_fork_server(living_run) as client:
        yield client


@pytest.fixture
def run(make_run: Callable[..., RunInfo]) -> RunInfo:
    return make_run(slam=PRESETS["realtime"])


@pytest.fixture
def fork_client(run: RunInfo) -> Iterator[ForkClient]:
    with started_fork_server(run) as client:
        yield client


def _start(fork_client: ForkClient, run: RunInfo, behaviour: str) -> Process:
    (run.path / "at_work").unlink(missing_ok=True)
    (run.path / "behaviour").write_text(behaviour)
    return fork_client.spawn(_SAMPLE, run.path)


def _wait_for(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _is_ready(process: Process) -> bool:
    """Born, and in its loop: the sample hears when it is to end then."""
    if process.poll() is not None or process.pid is None:
        return False
    return catches(process.pid, END_SIGNAL)


def test_a_forked_process_is_a_child_with_a_name_a_session_and_a_log(
    living_client: ForkClient, living_run: RunInfo
):
    process = _start(living_client, living_run, "obedient")
    _wait_for(lambda: _is_ready(process))
    assert process.pid is not None
    seen = psutil.Process(process.pid)
    assert seen.ppid() == os.getpid()
    assert seen.cmdline()[0].endswith(f" -P -m {_SAMPLE} --run {living_run.run_dir}")
    assert seen.name() == "hsslam-sample_worker"[:15]
    assert os.getsid(process.pid) == process.pid
    assert living_client.pid != process.pid
    process.send_signal(END_SIGNAL)
    assert process.wait(10) == 0
    assert (living_run.path / "ended").read_text() == "in order"


def test_exit_codes_and_what_was_said_arrive(living_client: ForkClient, living_run: RunInfo):
    assert _start(living_client, living_run, "bad input").wait(60) == 2
    assert "error: field = 3" in (living_run.path / "logs" / "sample_worker.log").read_text()
    assert _start(living_client, living_run, "crash").wait(60) == -signal.SIGABRT


def test_a_forked_process_has_its_kernels_from_the_fork_server(
    living_client: ForkClient, living_run: RunInfo
):
    process = _start(living_client, living_run, "warm")
    _wait_for(lambda: process.poll() is not None or (living_run.path / "at_work").exists())
    process.send_signal(END_SIGNAL)
    assert process.wait(10) == 0


def test_when_the_fork_server_dies_its_forks_live_on_and_others_come(
    fork_client: ForkClient, run: RunInfo
):
    first = _start(fork_client, run, "obedient")
    _wait_for(lambda: _is_ready(first))
    old = fork_client.pid
    assert old is not None
    os.kill(old, signal.SIGSTOP)
    second = _start(fork_client, run, "obedient")  # waits in the fork server that dies
    os.kill(old, signal.SIGKILL)
    _wait_for(lambda: _is_ready(second))
    _wait_for(lambda: fork_client.tick() or fork_client.news)
    assert fork_client.news == ["fork server was killed by SIGKILL: restarted"]
    assert fork_client.pid != old
    assert first.poll() is None
    for process in (first, second):
        process.send_signal(END_SIGNAL)
        assert process.wait(10) == 0


@pytest.mark.parametrize(("sound_s", "last"), [(0.0, "restarted"), (60.0, "too many restarts")])
def test_it_is_given_up_only_if_it_dies_again_and_again_at_once(
    fork_client: ForkClient, monkeypatch: pytest.MonkeyPatch, sound_s: float, last: str
):
    monkeypatch.setattr("hsslam_services.launch.restart_policy._SOUND_S", sound_s)
    for kills in range(1, 7):
        assert fork_client.pid is not None
        os.kill(fork_client.pid, signal.SIGKILL)
        _wait_for(lambda kills=kills: fork_client.tick() or len(fork_client.news) == kills)
    assert last in fork_client.news[-1]


def test_one_that_cannot_be_started_is_tried_again(run: RunInfo, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("hsslam_services.launch.fork_client._RETRY_S", 0.0)
    log = run.path / "logs" / "fork_server.log"
    log.mkdir(parents=True)
    link = ForkClient(run.path)
    try:
        link.start()
        link.tick()
        assert len(link.news) == 1 and "tried again every" in link.news[0]
        assert link.pid is None
        log.rmdir()
        process = _start(link, run, "obedient")
        assert link.pid is not None
        _wait_for(lambda: _is_ready(process))
        assert process.is_forked
        process.send_signal(END_SIGNAL)
        assert process.wait(10) == 0
    finally:
        link.close()


def test_one_that_is_called_off_is_not_born(living_client: ForkClient, living_run: RunInfo):
    assert living_client.pid is not None
    os.kill(living_client.pid, signal.SIGSTOP)  # the request waits, as while a fork server imports
    process = _start(living_client, living_run, "obedient")
    assert process.pid is None
    process.kill()
    assert process.wait(1) == -signal.SIGKILL
    os.kill(living_client.pid, signal.SIGCONT)
    after = _start(living_client, living_run, "obedient")
    _wait_for(lambda: _is_ready(after))
    children = [c for c in psutil.Process().children() if c.status() != psutil.STATUS_ZOMBIE]
    samples = [c.pid for c in children if _SAMPLE in " ".join(c.cmdline())]
    assert samples == [after.pid]
    after.kill()
    assert after.wait(10) == -signal.SIGKILL


def test_a_frozen_process_that_is_waited_for_is_a_timeout(
    living_client: ForkClient, living_run: RunInfo
):
    process = _start(living_client, living_run, "deaf")
    _wait_for(lambda: process.poll() is None and process.pid is not None)
    with pytest.raises(subprocess.TimeoutExpired):
        process.wait(0.05)
    process.kill()
    assert process.wait(10) == -signal.SIGKILL


_WITHOUT_META_KERNELS = """
import sys
from dataclasses import replace
from hsslam_services.launch.fork_server import leave_out_meta_kernels
leave_out_meta_kernels()
import torch
assert "torch._decomp" not in sys.modules, "it is no longer the meta kernels that import it"
from hsslam_node.kernels.tracking.depth_points import sample_points
from hsslam_node.kernels.view_mean import add_view, average_depth
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.warm_start import textured_wall, warm_start
from tests.small_room import SMALL
warm_start(PRESETS["realtime"])
print([len(kernel.signatures) for kernel in (sample_points, add_view, average_depth)])
slam = Slam(replace(SMALL, mapper=replace(SMALL.mapper, first_iterations=20)))
print([slam.process(frame).status for frame in textured_wall(2)])
print(torch.ones(3).share_memory_().sum().item())
"""


def test_without_meta_kernels_of_torch_a_camera_is_tracked_and_memory_is_shared():
    """The kernels that average noisy depth are loaded before a frame needs them."""
    command = [sys.executable, "-c", _WITHOUT_META_KERNELS]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    loaded, statuses, total, _ = done.stdout.split("\n")
    assert (loaded, statuses, total) == ("[1, 1, 1]", "['initial', 'tracked']", "3.0")
