"""The example client that uses nothing of this package; `control/test_ctl.py` runs it on a real run."""

import subprocess
import sys

from hsslam_services.bus.bus import free_endpoint, open_router
from tests.repository import ROOT

EXAMPLE = ROOT / "examples/wire_client.py"


def test_it_needs_only_zenoh_and_msgpack():
    lines = EXAMPLE.read_text().splitlines()
    imported = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert imported == {"json", "sys", "time", "msgpack", "zenoh"}
    start = next(k for k, line in enumerate(lines) if line.startswith("import"))
    assert len([line for line in lines[start:] if line]) <= 33


def test_no_service_is_one_line():
    endpoint = free_endpoint()
    for given in (endpoint, endpoint.removeprefix("tcp/")):
        done = subprocess.run([sys.executable, EXAMPLE, given], capture_output=True, text=True)
        assert done.returncode == 1
        assert done.stderr == f"{given}: no service: expected hsslam-serve --zenoh-port 7447\n"


def test_no_run_of_the_robot_is_one_line():
    endpoint = free_endpoint()
    router = open_router(endpoint)
    command = [sys.executable, EXAMPLE, endpoint, "other"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    router.close()
    assert done.returncode == 1
    assert done.stderr == f"no run of robot 'other' at {endpoint}\n"


def test_wrong_arguments_are_one_line():
    for words in (["tcp/127.0.0.1:1", "robot", "many"], ["a", "b", "3", "c"]):
        done = subprocess.run([sys.executable, EXAMPLE, *words], capture_output=True, text=True)
        assert done.returncode == 1
        assert done.stderr.endswith(
            "expected ENDPOINT ROBOT POSES, as tcp/127.0.0.1:7447 robot 100\n"
        )
