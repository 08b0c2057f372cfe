"""A lockstep run from a lossless log gives the poses of the run that wrote it."""

import json

import pytest

from tests.services.serve_process import SMALL_ROOM

pytestmark = pytest.mark.e2e

_SMALL = [option for option in SMALL_ROOM if option not in ("--source", "synth:room")]


def test_a_replayed_lockstep_run_has_the_same_poses_bit_for_bit(serve):
    options = ("--pace", "lockstep", "--seed", "3", *_SMALL)
    room = ("--source", "synth:room", "--frames", "20", "--noise", "kinect")
    logged = serve(*options, *room, "--log-color", "png", "--log-part-mb", "1")
    assert logged.finish(timeout_s=280) == 0, logged.stderr
    parts = json.loads((logged.out / "recorder.json").read_text())["parts"]
    assert len(parts) > 1
    replayed = serve(*options, "--source", f"mcap:{logged.out}")
    assert replayed.finish(timeout_s=280) == 0, replayed.stderr
    assert replayed.summary()["frames"]["in"] == 20
    for name in ("trajectory.txt", "trajectory_online.txt", "keyframes.txt"):
        assert (logged.out / name).read_bytes() == (replayed.out / name).read_bytes(), name
