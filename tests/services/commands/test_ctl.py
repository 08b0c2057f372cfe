"""`hsslam-ctl`: what it refuses by itself, and a whole run that it steers."""

import contextlib
import io
import json
import re
import subprocess
import sys

import numpy as np
import pytest
import trimesh
import zenoh

from hsslam_node.dense_map.answers import MapAnswers
from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_proto.codec import encode, encoding_of
from hsslam_proto.point_codec import answers_message
from hsslam_proto.request_messages import Refusal
from hsslam_proto.requests import QUERY, REFUSAL
from hsslam_services.bus.zenoh_session import open_client
from hsslam_services.commands.ctl import main
from hsslam_services.commands.ctl_options import CtlOptions
from tests.examples.test_wire_client import EXAMPLE
from tests.services.serve_process import SMALL_ROOM, ServeProcess

_OF_MAP = ("tracker", "mapper", "global_ba", "mesher")
_OF_RUN = ("camera", "recorder")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "no request: expected status | mesh"),
        (("statsu",), "statsu: unknown request: .*did you mean status"),
        (("save",), "save: expected save NAME"),
        (("status", "x"), "status x: expected status alone"),
        (("set-mode",), "set-mode: expected set-mode mapping|localise-only"),
        (("set-mode", "maping"), "set-mode maping: expected mapping or .*did you mean mapping"),
        (("query", "1", "2"), "query 1 2: expected query X Y Z"),
        (("query", "1", "2", "east"), "query 1 2 east: expected query X Y Z in metres"),
        (("query", "1", "-2", "nan"), "query 1 -2 nan: expected query X Y Z in metres"),
        (
            ("query", "1", "-2", "1e300"),
            "query 1 -2 1e300: expected query X Y Z in metres, at most 1000000",
        ),
        (("query", "-x", "2", "1"), "-x: unknown option"),
        (("locate", "1", "2"), "locate 1 2: expected locate X Y YAW"),
        (("locate", "1", "2", "n"), "locate 1 2 n: expected locate X Y YAW in metres and degrees"),
        (
            ("locate", "0", "0", "20000"),
            "locate 0 0 20000: expected locate X Y YAW in metres and degrees, at most 1000000 and 10000",
        ),
        (("save", "../x"), "map '../x': expected a name of letters"),
        (("status", "--connect", "localhost"), "--connect localhost: expected an endpoint"),
        (("status", "--out", "x"), "--out x: expected with mesh or trajectory only"),
        (("mesh", "--json"), "--json: expected without mesh, whose answer is a file"),
        (("mesh", "--out", "/nowhere/x.ply"), "--out /nowhere/x.ply: expected a file in a folder"),
        (("mesh", "--out", "x.glb"), "--out x.glb: expected a file .ply"),
        (("mesh", "--out", "x"), "--out x: expected a file .ply"),
        (("status", "--timeout-s", "0"), "--timeout-s 0.0: expected seconds above 0"),
        (("status", "--run", "/nowhere"), "/nowhere/run.json: No such file"),
        (("status", "--rum", "a"), "--rum: unknown option; did you mean --run"),
    ],
)
def test_bad_input_is_one_line_and_code_2(arguments, text, capsys):
    with pytest.raises(SystemExit) as exit_:
        main(arguments)
    assert exit_.value.code == 2
    told = capsys.readouterr().err
    assert re.search(text.replace("|", r"\|"), told), told
    assert told.count("\n") == 1


def test_no_service_is_code_1():
    command = [sys.executable, "-m", "hsslam_services.commands.ctl"]
    command += ["status", "--connect", "tcp/127.0.0.1:9", "--timeout-s", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert done.stderr.startswith("no service: ")


def test_options_are_checked():
    with pytest.raises(UserError, match="--robot"):
        CtlOptions(robot="a/b")


@pytest.mark.e2e
def test_a_run_is_steered_from_outside(serve, tmp_path):
    maps = tmp_path / "maps"
    run = serve(*SMALL_ROOM, "--synth.length", "1500", "--maps", str(maps))
    run.wait_for_poses(10)
    me = ("--run", str(run.out))

    status = json.loads(_expect("status", "--json", *me))
    assert status["state"] == "running"
    assert status["frames_tracked"] >= 10 and status["keyframes"] >= 1
    assert status["processes"]["tracker"] == "running"

    _expect_foreign_client(run.endpoint)

    assert _expect("pause", *me) == "paused\n"
    assert json.loads(_expect("pause", "--json", *me)) == {"text": "was paused already"}
    held = _frames_when_still(run, me)
    counters = [beat.counters for beat in run.heartbeats("camera", 4)]
    assert len({each["sent"] for each in counters}) == 1 and _frames(me) == held
    assert counters[0]["source_frames"] == 1500
    assert "paused" in _expect("status", *me)

    assert f"{maps / 'room.safetensors'}: " in _expect("save", "room", *me)
    assert load_checkpoint(maps / "room.safetensors").layout.parameter_count > 0
    again = _ctl("save", "room", *me)
    assert again.returncode == 1
    assert "refused: save: map room already exists" in again.stderr

    out = tmp_path / "now.txt"
    assert f"{held} poses" in _expect("trajectory", "--out", str(out), *me)
    assert len(read_tum(out)) == held
    assert _expect("trajectory", *me) == out.read_text()

    mesh = tmp_path / "now.ply"
    run.wait_until(lambda: _ctl("mesh", "--out", str(mesh), *me).returncode == 0, 60)
    assert len(trimesh.load_mesh(mesh).faces) > 100

    (told,) = json.loads(_expect("query", "--json", "0", "-0.1", "0.5", *me))
    assert told["point"] == [0.0, -0.1, 0.5] and told["known"] and told["certainty"] > 0.5
    assert told["distance_m"] > 0.05
    assert re.search(r"0\s+-0.1\s+0.5\s+1.\d+ .*yes", _expect("query", "0", "-0.1", "0.5", *me))

    assert _expect("set-mode", "localise-only", *me) == "localise-only\n"
    assert _expect("set-mode", "localise-only", *me) == "was localise-only already\n"
    held = _status(me)
    refused = _ctl("reset", *me)
    assert refused.returncode == 1 and "refused: reset: the mode is localise-only" in refused.stderr
    assert _expect("resume", *me) == "running\n"
    # a keyframe would come at the latest after four
    run.wait_until(lambda: _frames(me) > held["frames_tracked"] + 8, 60)
    now = _status(me)
    assert now["mode"] == "localise-only"
    _expect_to_be_located(me)
    assert (now["keyframes"], now["map_version"]) == (held["keyframes"], held["map_version"])
    assert _expect("set-mode", "mapping", *me) == "mapping\n"
    assert _status(me)["mode"] == "mapping"
    _expect_new_epoch(run, me)
    assert _expect("stop", *me) == "stopping\n"
    assert run.finish() == 0, run.stderr
    run.expect_nothing_left()
    summary = run.summary()
    assert summary["stop_reason"] == "asked to stop"
    assert summary["requests"]["received"] > summary["requests"]["refused"] >= 1
    assert "is set back" not in run.stderr
    assert summary["processes"]["recorder"]["restarts"] == 0
    _expect_two_trajectories(run, summary)
    assert _ctl("status", *me).stderr == f"no service: the run of {run.out} has ended\n"


def _expect_to_be_located(me: tuple[str, ...]) -> None:
    """The camera has hardly left the place where it began, which looks along x from the origin."""
    found = json.loads(_expect("locate", "--json", "0.3", "-0.2", "10", *me))
    assert abs(found["x"]) < 1 and abs(found["y"]) < 1 and abs(found["yaw_deg"]) < 50
    assert found["up_by"] in ("floor plane", "camera poses")
    assert _expect("locate", "0", "0", "0", *me).startswith("found at ")
    for place, why in (
        (("50", "0", "0"), "no keyframe near 50.00 0.00 0 looks that way: keyframes stand at x "),
        (("0", "0", "180"), "no keyframe near 0.00 0.00 180 looks that way"),
        (("1.8", "0", "0"), "not found at 1.80 0.00 0: the camera is tracked at "),
    ):
        refused = _ctl("locate", *place, *me)
        assert refused.returncode == 1 and f"refused: locate: {why}" in refused.stderr


def _expect_new_epoch(run, me: tuple[str, ...]) -> None:
    """A reset replaces whoever holds the map, and nobody else; poses begin anew at the origin."""
    old = {name: run.pid_of(name) for name in (*_OF_MAP, *_OF_RUN)}
    assert _expect("pause", *me) == "paused\n"
    assert _expect("reset", *me) == "map discarded: map epoch 1 begins\n"
    assert "refused: reset: there is no map yet" in _ctl("reset", *me).stderr
    assert "refused: trajectory: there is no pose yet" in _ctl("trajectory", *me).stderr
    now = _status(me)
    assert (now["state"], now["map_epoch"], now["keyframes"], now["map_version"]) == (
        "paused",
        1,
        0,
        0,
    )
    assert _expect("resume", *me) == "running\n"
    run.wait_until(lambda: all(run.pid_of(name) not in (None, old[name]) for name in _OF_MAP), 60)
    run.wait_until(lambda: len(_trajectory(me)) > 8, 60)
    run.wait_for_poses(1)
    assert all(run.pid_of(name) == old[name] for name in _OF_RUN)
    first = next(pose for pose in run.poses if pose.map_epoch == 1)
    assert first.status == "initial" and first.t == (0.0, 0.0, 0.0)
    assert all(pose.map_epoch == (pose.index >= first.index) for pose in run.poses)
    held, now = now, _status(me)
    assert now["keyframes"] > 0 and now["restarts"] == {}
    stamps_s = [float(line.partition(" ")[0]) for line in _trajectory(me)]  # of the new epoch alone
    assert len(stamps_s) > 8 and min(stamps_s) == pytest.approx(1e-9 * first.source_stamp_ns)
    # the status may be a frame behind the log
    run.wait_until(lambda: _frames(me) - held["frames_tracked"] >= len(stamps_s), 20)


def _expect_two_trajectories(run, summary: dict) -> None:
    """What was tracked before the reset lies in files of its own."""
    counts = [summary["map_epochs"][epoch] for epoch in ("0", "1")]
    times = [read_tum(run.out / of_epoch["trajectory"]).stamps_ns for of_epoch in counts]
    assert [len(stamps) for stamps in times] == [of_epoch["tracked"] for of_epoch in counts]
    assert times[0].max() < times[1].min()
    assert counts[1]["trajectory"] == "trajectory.txt"
    for key in ("tracked", "lost"):
        assert sum(of_epoch[key] for of_epoch in counts) == summary["frames"][key]
    assert len(read_tum(run.out / "keyframes.epoch0.txt")) == counts[0]["keyframes"]


def test_a_question_that_the_service_goes_on_with_is_asked_again(endpoint):
    """It answers too late, then it has not looked through all keyframes twice; then it answers."""
    count, asked = 4, []

    def answer(query: zenoh.Query) -> None:
        asked.append(query.payload)
        if len(asked) == 1 or query.key_expr != QUERY.key("r"):
            query.reply_err(b"Timeout")  # as zenoh says it itself
            return
        if (left := count - len(asked)) > 0:
            refusal = Refusal(reason="unfinished", text=f"query: {left} of 4 keyframes: ask again")
            encoding = zenoh.Encoding(encoding_of(REFUSAL))
            query.reply_err(encode(REFUSAL, refusal), encoding=encoding)
            return
        found = MapAnswers(
            np.array([0.25], np.float32), np.zeros((1, 3), np.float32), np.ones(1, bool),
            np.ones(1, np.float32),
        )  # fmt: skip
        payload = encode(QUERY.answered, answers_message(found, 7, 0))
        encoding = zenoh.Encoding(encoding_of(QUERY.answered))
        query.reply(query.key_expr, payload, encoding=encoding)

    me = ("--connect", endpoint, "--robot", "r")
    with open_client(endpoint) as service:
        queryable = service.declare_queryable("hsslam/r/rpc/*", answer)
        while not asked:  # until the router knows it
            _ctl("query", "0", "0", "1", *me)
        asked.clear()
        done = _ctl("query", "0", "0", "1", *me)
        assert done.returncode == 0 and "0.25" in done.stdout
        assert len(asked) == 4
        late, *unfinished = done.stderr.splitlines()
        assert late == "timeout: no answer to query within 15 s"
        assert [line.split()[2] for line in unfinished] == ["2", "1"]
        asked.clear()
        assert _ctl("query", "0", "0", "1", "--timeout-s", "9", *me).returncode == 1
        assert _ctl("pause", *me).returncode == 1  # never done twice
        queryable.undeclare()
    assert len(asked) == 2


def _expect_foreign_client(endpoint: str) -> None:
    """The example that uses nothing of this package reads status and poses."""
    command = [sys.executable, EXAMPLE, endpoint, "robot", "5"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    status, *poses = done.stdout.splitlines()
    assert status.startswith("status: running keyframes: ")
    indices = [int(line.split()[0]) for line in poses]
    assert len(indices) == 5 and indices == sorted(indices)
    assert all(len(line.split()) == 5 for line in poses)


def _ctl(*arguments: str) -> subprocess.CompletedProcess:
    """The command in this process: a new interpreter each time takes its time."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(arguments)
        except SystemExit as exit_:
            code = int(exit_.code or 0)
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def _expect(*arguments: str) -> str:
    done = _ctl(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def _trajectory(me: tuple[str, ...]) -> list[str]:
    """Its rows; none where there is no pose yet."""
    answer = _ctl("trajectory", *me)
    return [line for line in answer.stdout.splitlines() if line[0] != "#"]


def _frames(me: tuple[str, ...]) -> int:
    return _status(me)["frames_tracked"]


def _status(me: tuple[str, ...]) -> dict:
    return json.loads(_expect("status", "--json", *me))


def _frames_when_still(run: ServeProcess, me: tuple[str, ...]) -> int:
    """Poses when the last frames that were on their way have been tracked."""
    before, now = -1, _frames(me)
    while now != before:
        run.heartbeats("tracker")
        before, now = now, _frames(me)
    return now
