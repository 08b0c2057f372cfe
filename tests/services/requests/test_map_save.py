"""A client that has asked for a map to be saved gets an answer, whatever becomes of the saver."""

import os
import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import msgspec
import pytest

from hsslam_proto.request_messages import SavedMap, SaveMap
from hsslam_proto.requests import SAVE
from hsslam_services.bus.ask import NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.disk.disk_work import DiskWork
from hsslam_services.requests.map_save import MapSaving
from hsslam_services.run.process_result import ProcessResult, write_result
from hsslam_services.run.run_info import RunInfo


@pytest.mark.parametrize(
    ("timeout_s", "answer"),
    [(0.1, "save: not done after 0.1 s: killed"), (60.0, "save: the run has ended")],
)
def test_a_client_is_told_of_a_saver_that_hangs(run_info: RunInfo, timeout_s: float, answer: str):
    hangs: list[subprocess.Popen] = []

    def spawn(*_: object) -> subprocess.Popen:
        hangs.append(subprocess.Popen(["sleep", "60"]))
        return hangs[-1]

    with (
        Bus(run_info.endpoint, run_info.robot, "supervisor") as bus,
        ThreadPoolExecutor(1) as client,
    ):
        requests, saving = bus.requests(), MapSaving(run_info, spawn, timeout_s)
        told = client.submit(_refusal, run_info)
        while (asked := requests.poll()) is None:
            time.sleep(0.005)
        saving.ask(asked)
        while timeout_s < 1.0 and saving.is_busy:
            saving.tick()
            time.sleep(0.005)
        saving.close()
        assert answer in told.result(30)
    assert hangs[0].poll() is not None


def test_a_client_is_told_of_a_saved_map_though_the_disk_is_slow(run_info: RunInfo):
    """A pipe without a writer, which a reader cannot open, is a disk that is slow."""
    slow = run_info.path / "slow"
    os.mkfifo(slow)
    disk = DiskWork()
    saved = SavedMap(name="kitchen", path="maps/kitchen", nbytes=7, keyframes=9)

    def spawn(*_: object) -> subprocess.Popen:
        result = ProcessResult(answer=msgspec.to_builtins(saved))
        write_result(run_info.path, "map_saver", result)
        process = subprocess.Popen(["true"])
        process.wait()
        return process

    with (
        Bus(run_info.endpoint, run_info.robot, "supervisor") as bus,
        ThreadPoolExecutor(1) as client,
    ):
        requests, saving = bus.requests(), MapSaving(run_info, spawn, disk=disk)
        told = client.submit(_answer, run_info)
        while (asked := requests.poll()) is None:
            time.sleep(0.005)
        saving.ask(asked)
        disk.ask(slow.read_text)
        while disk.silent_s() < 1.1:  # longer than a turn of the loop may wait
            saving.tick()
            time.sleep(0.005)
        assert saving.is_busy
        slow.write_text("")
        while saving.is_busy:
            saving.tick()
            time.sleep(0.005)
        assert told.result(30) == saved


def test_the_same_request_during_its_save_gets_the_same_answer(run_info: RunInfo):
    """A busy zenoh may send a request twice; another request is refused."""
    saved = SavedMap(name="kitchen", path="maps/kitchen", nbytes=7, keyframes=9)
    saves: list[subprocess.Popen] = []

    def spawn(*_: object) -> subprocess.Popen:
        saves.append(subprocess.Popen(["cat"], stdin=subprocess.PIPE))
        return saves[-1]

    with (
        Bus(run_info.endpoint, run_info.robot, "supervisor") as bus,
        ThreadPoolExecutor(3) as clients,
    ):
        requests, saving = bus.requests(), MapSaving(run_info, spawn)
        told = []
        for name in ("kitchen", "kitchen", "hall"):
            told.append(clients.submit(_answer, run_info, name))
            while (asked := requests.poll()) is None:
                time.sleep(0.005)
            saving.ask(asked)
        with pytest.raises(RefusedError, match="another map is being saved"):
            told.pop().result(30)
        write_result(run_info.path, "map_saver", ProcessResult(answer=msgspec.to_builtins(saved)))
        saves[0].communicate()
        while saving.is_busy:
            saving.tick()
            time.sleep(0.005)
        assert [each.result(30) for each in told] == [saved, saved]
    assert len(saves) == 1


def _refusal(run: RunInfo) -> str:
    try:
        _answer(run)
    except RefusedError as refusal:
        return str(refusal)
    return ""


def _answer(run: RunInfo, name: str = "kitchen") -> object:
    while True:
        try:
            return ask(run.endpoint, run.robot, SAVE, SaveMap(name=name))
        except NoServiceError:  # the router knows the gateway a moment later
            continue
