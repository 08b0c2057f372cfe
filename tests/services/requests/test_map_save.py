"""A client that has asked for a map to be saved gets an answer, whatever becomes of the saver."""

import subprocess
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from hsslam_proto.request_messages import SaveMap
from hsslam_proto.requests import SAVE
from hsslam_services.bus.ask import NoServiceError, RefusedError, ask
from hsslam_services.bus.bus import Bus
from hsslam_services.requests.map_save import MapSaving
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


def _refusal(run: RunInfo) -> str:
    while True:
        try:
            ask(run.endpoint, run.robot, SAVE, SaveMap(name="kitchen"))
        except RefusedError as refusal:
            return str(refusal)
        except NoServiceError:  # the router knows the gateway a moment later
            continue
