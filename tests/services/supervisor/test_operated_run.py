"""A run as it is operated from outside: behind certificates, its health and numbers over HTTP."""

import json
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import psutil
import pytest

from hsslam_services.bus.bus import free_endpoint
from hsslam_services.commands.certs import make_certificates
from tests.services.serve_process import SMALL_ROOM, ServeProcess

pytestmark = pytest.mark.e2e


def test_certificates_health_and_numbers_of_a_run(serve, tmp_path: Path):
    make_certificates(tmp_path / "certs", (), 1)
    port = int(free_endpoint().rpartition(":")[2])
    options = ("--security", str(tmp_path / "certs/router"), "--metrics-port", str(port))
    run = serve(*SMALL_ROOM, *options)

    def ask(request: str, role: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "hsslam_services.commands.ctl", request]
        place = ["--connect", run.endpoint.replace("tcp/", "tls/")]
        who = ["--security", str(tmp_path / "certs" / role)]
        return subprocess.run([*command, *place, *who], capture_output=True, text=True)

    assert _wait_for(run, port, 200)["status"] in ("ok", "degraded")
    run.wait_until(lambda: _metric(port, "hsslam_frames_tracked_total") > 5, 60)
    assert _metric(port, "hsslam_latency_seconds_count") > 5
    assert _metric(port, "hsslam_map_iterations_total") > 0
    assert 0.9 < _metric(port, "hsslam_certificate_valid_days") < 1.0

    tracker = run.pid_of("tracker")
    assert tracker is not None
    psutil.Process(tracker).kill()
    assert "tracker" in _wait_for(run, port, 503)["not_running"]
    _wait_for(run, port, 200)
    assert _metric(port, 'hsslam_process_restarts_total{process="tracker"}') == 1

    refused = ask("stop", "viewer")
    assert (
        refused.returncode == 1
        and "this certificate does not allow the request stop" in refused.stderr
    )
    assert "tracked" in ask("status", "viewer").stdout
    done = ask("stop", "operator")
    assert (done.returncode, done.stdout) == (0, "stopping\n"), done.stderr
    assert run.finish() == 0, run.stderr
    assert "zenoh: tls/127.0.0.1" in run.stderr
    assert "in 24.0 hours: hsslam-certs DIR --ca FOLDER makes new ones" in run.stderr
    assert run.summary()["frames"]["tracked"] > 5
    run.expect_nothing_left()


def _wait_for(run: ServeProcess, port: int, code: int) -> dict:
    """The first answer with this code."""
    answers = [(0, {})]
    run.wait_until(lambda: answers.append(_health(port)) or answers[-1][0] == code, 120)
    return answers[-1][1]


def _health(port: int) -> tuple[int, dict]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=10) as answer:
            return answer.status, json.load(answer)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)
    except OSError:
        return 0, {}


def _metric(port: int, name: str) -> float:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
        lines = answer.read().decode().splitlines()
    return next(float(line.split()[-1]) for line in lines if line.startswith(f"{name} "))
