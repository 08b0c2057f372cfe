"""When a run counts as healthy."""

import dataclasses

import pytest

from hsslam_services.health.snapshot import health_of
from tests.services.health.sample_snapshot import snapshot

_NOW_S = 101.0


@pytest.mark.parametrize(
    ("processes", "status", "code", "word"),
    [
        ({}, {}, 200, "ok"),
        ({"camera": "ended"}, {}, 200, "ok"),
        ({"mesher": "waiting"}, {}, 200, "degraded"),
        ({"recorder": "failed"}, {}, 200, "degraded"),
        ({}, {"state": "paused"}, 200, "paused"),
        ({"tracker": "ended"}, {"state": "stopping"}, 200, "stopping"),
        ({"tracker": "waiting"}, {}, 503, "down"),
        ({"mapper": "stalled"}, {}, 503, "down"),
        ({"camera": "failed"}, {}, 503, "down"),
        ({"mapper": "starting"}, {"state": "paused"}, 503, "down"),
        ({"tracker": "starting"}, {"state": "starting", "restarts": {}}, 503, "starting"),
        ({"tracker": "failed"}, {"state": "starting", "restarts": {}}, 503, "down"),
        ({"tracker": "starting"}, {"state": "starting", "restarts": {"tracker": 1}}, 503, "down"),
    ],
)
def test_needed_processes_decide(processes, status, code, word):
    found, body = health_of(snapshot(processes, **status), _NOW_S)
    assert (found, body["status"]) == (code, word)
    assert set(body["not_running"]) == {n for n in processes if processes != {"camera": "ended"}}


def test_frames_without_poses_are_no_health():
    for silent_s, code, word in ((4.9, 200, "ok"), (5.1, 503, "silent")):
        found, body = health_of(dataclasses.replace(snapshot(), silent_s=silent_s), _NOW_S)
        assert (found, body["status"], body["silent_s"]) == (code, word, silent_s)


def test_a_disk_that_does_not_answer_is_told_and_the_run_goes_on():
    for silent_s, word in ((4.9, "ok"), (5.1, "degraded")):
        found, body = health_of(dataclasses.replace(snapshot(), disk_silent_s=silent_s), _NOW_S)
        assert (found, body["status"], body["disk_silent_s"]) == (200, word, silent_s)


@pytest.mark.parametrize(("age_s", "told"), [(None, None), (7200.04, 7200.0)])
def test_a_camera_that_sends_nothing_is_no_fault_and_the_age_of_its_last_pose_is_told(age_s, told):
    quiet = dataclasses.replace(snapshot(tracking="none", fps=0.0), pose_age_s=age_s)
    code, body = health_of(quiet, _NOW_S)
    assert (code, body["status"], body["tracking"], body["pose_age_s"]) == (200, "ok", "none", told)


def test_a_supervisor_that_hangs_and_one_that_only_begins():
    assert health_of(snapshot(), 111.0)[0] == 503
    assert health_of(snapshot(), 111.0)[1]["status"] == "hung"
    assert health_of(None) == (503, {"status": "starting"})
