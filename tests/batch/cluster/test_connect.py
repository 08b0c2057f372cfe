"""Ray of this machine gets more than one chance to start; a cluster that is not there gets one."""

import os
import signal
import socket
import subprocess
import sys
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from hsslam_batch.cluster.connect import connected
from hsslam_batch.cluster.ray_head import expect_ray_head
from hsslam_node.errors import UserError
from tests.until import until

_DRIVER = """
import sys
import threading
from pathlib import Path

import ray

from hsslam_batch.cluster.connect import connected
from hsslam_services.run.stop_signals import hear_stop_signals


def wait(folder):
    import time

    (folder / "begun").touch()
    while not (folder / "end").exists():
        time.sleep(0.05)
    return "the task has ended"


def end(folder):
    (folder / "end").touch()


folder, heard = Path(sys.argv[1]), threading.Event()
with connected("local"):
    hear_stop_signals(lambda count: heard.set())
    waiting = ray.remote(max_retries=0)(wait).remote(folder)
    heard.wait()
    ray.get(ray.remote(num_cpus=0, max_retries=0)(end).remote(folder), timeout=120)  # by a new worker
    print(ray.get(waiting, timeout=120))
"""


@pytest.fixture
def starts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that Ray was asked for; it starts at the third time."""
    import ray

    asked: list[str] = []

    def init(address: str, **_: object) -> None:
        asked.append(address)
        if len(asked) < 3:
            raise Exception("The current node timed out during startup.\nMore of it.")

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "shutdown", lambda: None)
    return asked


def test_ray_that_takes_too_long_to_start_is_started_again(starts: list[str]):
    with connected("local"):
        assert starts == ["local"] * 3


def test_a_client_server_whose_process_for_us_dies_is_asked_again(monkeypatch: pytest.MonkeyPatch):
    import ray

    asked: list[str] = []

    def init(address: str, **_: object) -> None:
        asked.append(address)
        if len(asked) < 3:
            raise ConnectionAbortedError(
                "Initialization failure from server:\nTraceback:\n"
                "RuntimeError: Starting Ray client server failed. See ray_client_server_23000.err"
            )

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "shutdown", lambda: None)
    with connected("here"):
        assert asked == ["here"] * 3


def test_a_cluster_that_refuses_is_asked_once(starts: list[str]):
    with (
        pytest.raises(UserError, match=r"^--address here: The current node timed out.*: exp"),
        connected("here"),
    ):
        pass
    assert starts == ["here"]


def test_the_error_of_a_server_is_its_last_line(monkeypatch: pytest.MonkeyPatch):
    import ray

    def init(address: str, **_: object) -> None:
        raise ConnectionAbortedError(
            "Failure from server:\nTraceback:\n  f()\nRuntimeError: busy.\n"
        )

    monkeypatch.setattr(ray, "init", init)
    with (
        pytest.raises(UserError, match=r"^--address here: RuntimeError: busy: exp"),
        connected("here"),
    ):
        pass


def _refusal(address: str) -> str:
    """The error at an address; Ray is not asked, as it would try for minutes."""
    with pytest.raises(UserError) as raised, connected(address):
        pass
    return str(raised.value)


def test_a_cluster_that_is_not_there_is_one_line_at_once(
    starts: list[str], monkeypatch: pytest.MonkeyPatch
):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    wanted = "Connection refused: expected a running Ray head, as of `ray start --head"
    here = f"127.0.0.1:{port}"
    refused = f"--address {here}: {wanted} --port {port}` on 127.0.0.1"
    assert _refusal(here) == refused
    refused = f"--address ray://{here}: {wanted} --ray-client-server-port {port}` on 127.0.0.1"
    assert _refusal(f"ray://{here}") == refused
    monkeypatch.setenv("RAY_ADDRESS", here)
    assert _refusal("auto").startswith(f"--address auto (RAY_ADDRESS {here}): {wanted}")
    assert not starts


def test_a_port_on_which_something_else_answers_is_one_line(starts: list[str]):
    with ThreadingHTTPServer(("127.0.0.1", 0), BaseHTTPRequestHandler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        here = f"127.0.0.1:{server.server_port}"
        told = f"--address {here}: what answers there is not Ray: expected a running Ray head"
        assert _refusal(here).startswith(told)
        server.shutdown()
    assert not starts


@pytest.mark.parametrize("address", ["[::1:6379", "ray://[::1", "[foo]:1"])
def test_what_is_no_address_is_left_to_ray(address: str):
    expect_ray_head(address)


@pytest.mark.parametrize("host", ["a..b", "a" * 70])
def test_what_is_no_name_of_a_host_is_one_line(host: str):
    with pytest.raises(UserError, match=rf"--address {host}:6379: .*: expected a running Ray head"):
        expect_ray_head(f"{host}:6379")


@pytest.mark.e2e
@pytest.mark.xdist_group("ray")  # one cluster at a time
def test_tasks_of_this_machine_finish_if_the_terminal_goes_away(tmp_path: Path):
    """The kernel then sends SIGHUP to all processes of the group, those of Ray among them."""
    driver = subprocess.Popen(
        [sys.executable, "-c", _DRIVER, str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # these tests may run under nohup
        preexec_fn=partial(signal.signal, signal.SIGHUP, signal.SIG_DFL),
    )
    until((tmp_path / "begun").exists, timeout_s=240.0)
    os.killpg(driver.pid, signal.SIGHUP)
    said, _ = driver.communicate(timeout=240.0)
    assert driver.returncode == 0 and said.endswith("the task has ended\n"), said


def test_a_terminal_that_goes_away_while_ray_starts_is_heard_afterwards(
    monkeypatch: pytest.MonkeyPatch,
):
    import ray

    heard: list[int] = []

    def init(address: str, **_: object) -> None:
        signal.raise_signal(signal.SIGHUP)
        assert not heard

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "shutdown", lambda: None)
    before = signal.signal(signal.SIGHUP, lambda number, _: heard.append(number))
    try:
        with connected("local"):
            assert heard == [signal.SIGHUP]
    finally:
        signal.signal(signal.SIGHUP, before)
