"""The main job end to end: what a run leaves, and what it leaves nothing of."""

import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import psutil
import pytest
from mcap.reader import make_reader

from hsslam_batch.attempt.outcome import figures
from hsslam_bench.checks.live_figures import messages_expected
from hsslam_bench.fuzz.sender import FuzzSender, open_sending_session
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import PAUSE, RESUME, STATUS
from hsslam_services.bus.ask import ask
from hsslam_services.launch.process_table import ProcessSpec, processes_of
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import ONE_REQUEST_S
from tests.repository import ROOT
from tests.services.serve_process import SMALL_ROOM, ServeProcess

pytestmark = pytest.mark.e2e
_TERMINATED = """
import os, signal
from hsslam_services.commands import serve, serve_command_line
parse = serve_command_line.parse_command_line
def terminated(arguments):
    os.kill(os.getpid(), signal.SIGTERM)
    return parse(arguments)
serve_command_line.parse_command_line = terminated
serve.main()
"""
_SWALLOWED = """
import os, signal
from hsslam_services.commands import serve, serve_command_line
parse = serve_command_line.parse_command_line
def interrupted(arguments):
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        pass  # as the import of a compiled module may do
    return parse(arguments)
serve_command_line.parse_command_line = interrupted
serve.main()
"""
_LONG_END = ("--finish-s", "60", "--slam.mapper.last-iterations", "100000")  # before the mesh
_STARTED_BADLY = """
import os, signal, sys
signal.signal(signal.SIGCHLD, signal.SIG_IGN)
os.closerange(0, 2)
os.execv(sys.argv[1], sys.argv[1:])
"""
_SAME_RESULTS = (
    *("trajectory.txt", "trajectory_online.txt", "keyframes.txt"),
    *("map.safetensors", "mesh.ply"),
)
_PROCESSES = processes_of(ServeOptions(source="synth:room"))


def _gives_way(run: ServeProcess, spec: ProcessSpec) -> bool:
    """Whether the process is there, and nice, and so is its session where that is what counts."""
    pid = run.pid_of(spec.name)
    if pid is None or psutil.Process(pid).nice() != spec.nice:
        return False
    session = Path(f"/proc/{pid}/autogroup")
    return not session.exists() or session.read_text().split()[-1] == str(spec.nice)


def _has_counted_each_frame(run: ServeProcess) -> bool:
    """Whether the frames that tracker and camera count add up; the run is paused."""
    sent = run.heartbeats("camera", 1)[-1].counters
    if (status := run.status()) is None:
        return False
    answered = status.frames_tracked + status.frames_lost
    return answered >= 20 and answered + status.frames_dropped == sent["sent"] + sent["skipped"]


def test_a_run_leaves_its_results_and_nothing_else(serve):
    run = serve(
        *SMALL_ROOM, "--frames", "60", "--evaluate", prefix=(sys.executable, "-c", _STARTED_BADLY)
    )
    run.wait_for_poses(20)
    ask(run.endpoint, "robot", PAUSE, Ask())  # the run cannot end meanwhile
    for spec in _PROCESSES:  # the last ones are born after the first pose
        run.wait_until(partial(_gives_way, run, spec), 20)
    run.wait_until(partial(_has_counted_each_frame, run), 20)
    ask(run.endpoint, "robot", RESUME, Ask())
    assert run.finish() == 0, run.stderr
    run.expect_nothing_left()

    summary = run.summary()
    frames = summary["frames"]
    assert frames["in"] == 60
    assert frames["tracked"] >= 25  # how many more is the benchmark's business
    assert summary["latency_ms"]["p95"] > 0
    assert summary["evaluation"]
    assert [name for name, value in figures(summary).items() if not value and name != "lost"] == []
    assert "evaluator: comparing with ground truth" in run.stderr
    assert run.stderr.count("the map is computed by") == 1
    assert summary["device"]["name"] in run.stderr and summary["device"]["reason"] in run.stderr
    assert summary["model_bytes"]
    documented = (ROOT / "docs/runs.md").read_text().partition("## Fields of summary.json")[2]
    assert [name for name in summary if f"`{name}`" not in documented.partition("\n## ")[0]] == []
    assert summary["memory"]["peak_pss_mb"] > summary["memory"]["peak_pss_mb_of"]["mapper"] > 0
    ended = [summary["processes"][spec.name] for spec in _PROCESSES]
    assert all((each["restarts"], each["exit_code"]) == (0, 0) for each in ended)
    assert len(read_tum(run.out / "trajectory.txt")) == frames["tracked"]
    assert len(read_tum(run.out / "trajectory_online.txt")) == frames["tracked"]
    assert len(read_tum(run.out / "keyframes.txt")) == summary["keyframes"]
    assert load_checkpoint(run.out / "map.safetensors").layout.parameter_count > 0
    assert (run.out / "mesh.ply").stat().st_size > 1000
    assert (run.out / "run.rrd").stat().st_size > 1000
    for mode, path in ((0o700, run.out), (0o600, run.out / "run.mcap")):  # others may not read them
        assert path.stat().st_mode & 0o777 == mode
    counts = _messages_per_topic(run.out / "run.mcap")
    expected = messages_expected(summary)
    assert {name: counts[f"hsslam/robot/{name}"] for name in expected} == expected


def test_the_end_of_a_session_saves_what_there_is_also_if_nothing_can_be_evaluated(serve):
    run = serve(*SMALL_ROOM, "--synth.length", "1500", "--evaluate")
    run.wait_for_poses(5)
    run.wait_until(lambda: all(run.pid_of(spec.name) for spec in _PROCESSES), 20)
    for worker in psutil.Process(run.process.pid).children():
        for number in (signal.SIGHUP, signal.SIGTERM):  # as systemd-logind does
            worker.send_signal(number)
    run.wait_for_poses(10)
    (run.out / "logs" / "evaluator.log").mkdir()  # in the way: it cannot be started
    run.signal(signal.SIGTERM)
    for _ in range(2):  # a shell sends it, and so does the kernel
        run.signal(signal.SIGHUP)
    assert run.finish() == 0, run.stderr
    run.expect_nothing_left()
    summary = run.summary()
    assert summary["stop_reason"] == "interrupted"
    assert all(process["restarts"] == 0 for process in summary["processes"].values())
    assert summary["not_saved"] == {} and "Is a directory" in summary["not_evaluated"]
    assert (
        f"not evaluated: {summary['not_evaluated']}; repeat it with hsslam-eval {run.out}"
        in run.stderr
    )
    assert len(read_tum(run.out / "trajectory.txt")) >= 15
    assert (run.out / "mesh.ply").exists()
    assert (run.out / "map.safetensors").exists()


@pytest.mark.parametrize("delay_s", [1.0, 3.0])  # before that, it is still Python that starts
def test_ctrl_c_during_the_start_ends_with_code_0(serve, delay_s: float):
    run = serve(*SMALL_ROOM)
    _sleep_unless_ended(run, delay_s)
    run.signal(signal.SIGINT)
    assert run.finish() == 0, run.stderr
    assert "Traceback" not in run.stderr
    run.expect_nothing_left()


def test_ctrl_c_ends_the_start_though_an_import_catches_its_exception(tmp_path: Path):
    command = [sys.executable, "-c", _SWALLOWED, *SMALL_ROOM, "--out", str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "run").exists()


def test_a_sigterm_to_the_first_process_of_a_container_ends_its_start(tmp_path: Path):
    """The kernel drops it if that process has no handler."""
    alone = ("unshare", "--pid", "--fork", "--mount-proc", "--kill-child")
    if subprocess.run([*alone, "true"], check=False, capture_output=True).returncode:
        pytest.skip("this user may not make a process namespace")
    out = tmp_path / "run"
    command = [sys.executable, "-c", _TERMINATED, *SMALL_ROOM, "--frames", "5", "--out", str(out)]
    done = subprocess.run([*alone, *command], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert not out.exists()


@pytest.mark.parametrize("code", [ExitCode.CUT_SHORT, ExitCode.NOT_SAVED])
def test_second_signal_ends_at_once_and_frees_nothing_that_could_not_be_saved(
    serve, code: ExitCode
):
    run = serve(*SMALL_ROOM, "--synth.length", "1500", *_LONG_END)
    run.wait_for_poses(5)
    (run.out / ".hsslam-0123456789abcdef.partial.ply").touch()  # as of a saver that was killed
    if code == ExitCode.NOT_SAVED:
        (run.out / "trajectory.txt").mkdir()
    run.signal(signal.SIGTERM)
    _sleep_unless_ended(run, 1.2 * ONE_REQUEST_S)
    run.signal(signal.SIGINT)
    assert run.finish(timeout_s=40) == code, run.stderr
    assert "mesh" in run.summary()["given_up"] and not (run.out / "mesh.ply").exists()
    assert "mesh not saved: a second signal ended the run" in run.stderr
    assert not list(run.out.glob(".hsslam-*"))
    if code == ExitCode.NOT_SAVED:
        assert run.stderr.strip().endswith(f"hsslam-serve rescue {run.arena_dir}")
        assert run.left_behind() == [str(run.arena_dir)]
    else:
        assert len(read_tum(run.out / "trajectory.txt")) >= 5
        run.expect_nothing_left()


def test_killed_supervisor_leaves_a_readable_log_and_nothing_else(serve):
    run = serve(*SMALL_ROOM, "--synth.length", "1500")
    run.wait_for_poses(15)
    (run.out / ".hsslam-0123456789abcdef.partial.txt").touch()
    run.kill_worker("watchdog")
    run.close_bus()
    run.signal(signal.SIGKILL)
    run.process.wait()
    run.expect_nothing_left(timeout_s=60)  # after the watchdog has saved what there is
    assert (run.out / "trajectory.txt").exists() and not list(run.out.glob(".hsslam-*"))
    assert _messages_per_topic(run.out / "run.mcap")["hsslam/robot/out/pose"] >= 15


@pytest.mark.alone  # the router cuts off a process that takes nothing of 256 MiB for a second
def test_lockstep_is_reproducible_bit_for_bit_and_repeated_from_its_folder(serve):
    options = (*SMALL_ROOM, "--pace", "lockstep", "--frames", "60", "--noise", "kinect")
    disturbed = serve(*options, "--seed", "3")
    disturbed.wait_for_poses(1)
    ask(disturbed.endpoint, "robot", PAUSE, Ask())  # a process that has ended counts nothing
    disturbed.wait_until(lambda: _state_of(disturbed, "recorder") == "running", timeout_s=60)
    socket = RunInfo.read(disturbed.out).endpoint  # a port would refuse most of them
    with open_sending_session(socket) as outside:  # what cannot be read changes nothing
        sent = FuzzSender(outside, "robot", seed=0, rate_hz=40).send(100)

    def all_counted() -> bool:
        status = ask(disturbed.endpoint, "robot", STATUS, Ask())
        return status.messages_rejected >= sent.messages.total()

    disturbed.wait_until(all_counted, timeout_s=30)
    ask(disturbed.endpoint, "robot", RESUME, Ask())
    alone = serve("--config", str(disturbed.out))
    for run in (alone, disturbed):
        assert run.finish(timeout_s=150) == 0, run.stderr
        assert run.summary()["frames"] == {**run.summary()["frames"], "in": 60, "dropped": 0}
        assert run.summary()["device"]["reason"] == "lockstep is reproducible on the CPU only"
    for name in _SAME_RESULTS:
        assert (alone.out / name).read_bytes() == (disturbed.out / name).read_bytes(), name
    differing = set(_config_lines(alone)) ^ set(_config_lines(disturbed))
    assert all(line.startswith("zenoh_port") for line in differing)
    summary = disturbed.summary()
    assert summary["rejected"] == dict(sent.messages)
    assert summary["requests"]["refused"] == sent.requests.total() == sent.refused
    assert all(process["restarts"] == 0 for process in summary["processes"].values())
    assert alone.summary()["rejected"] == {}


def _state_of(run, process: str) -> str | None:
    status = run.status()
    return status.processes[process] if status else None


def _config_lines(run) -> list[str]:
    return (run.out / "config.toml").read_text().splitlines()


def _messages_per_topic(path) -> dict[str, int]:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    return {c.topic: counts.get(c.id, 0) for c in summary.channels.values()}


def _sleep_unless_ended(run, seconds: float) -> None:
    try:
        run.process.wait(seconds)
    except Exception:
        return
