"""`hsslam-serve warm-up`: afterwards no process compiles; where it cannot work it says why."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from hsslam_node import __version__
from hsslam_node.kernels.cache_folder import kernel_cache_folder, warm_stamp
from hsslam_proto.request_messages import Ask
from hsslam_proto.requests import STOP
from hsslam_services.bus.ask import ask
from hsslam_services.launch.process_table import WARM_UP
from hsslam_services.launch.spawn import child_environment
from hsslam_services.run.exit_code import ExitCode
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo

_REHEARSAL = """
import gc
from numba.core.dispatcher import Dispatcher
from hsslam_node.presets import PRESETS
from hsslam_node.warm_start import warm_start
for preset in PRESETS.values():
    warm_start(preset)
kernels = [o for o in gc.get_objects() if isinstance(o, Dispatcher)]
print(sum(sum(k.stats.cache_hits.values()) for k in kernels))
print([k.py_func.__name__ for k in kernels if k.stats.cache_misses])
"""


def _warm_up(*args: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "hsslam_services.commands.serve", "warm-up", *args]
    return subprocess.run(
        command, env={**os.environ, **environment}, capture_output=True, text=True
    )


def test_afterwards_no_preset_compiles_anything(tmp_path: Path):
    """Also in programs with a cache of their own."""
    first, second = _warm_up(), _warm_up()
    assert first.returncode == second.returncode == 0, first.stderr
    assert second.stdout == f"kernels compiled before: {kernel_cache_folder()}\n"
    assert warm_stamp().exists()
    environment = {**child_environment(), "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", _REHEARSAL],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    loaded, compiled = done.stdout.splitlines()
    assert int(loaded) > 10
    assert compiled == "[]"


@pytest.mark.parametrize(
    "words", ["serve warm-up", "serve --source synth:room --out OUT", "doctor synth:room"]
)
def test_a_cache_that_cannot_be_written_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = kernel_cache_folder()
    folder.mkdir(parents=True)
    warm_stamp().touch()  # complete
    (folder / "tracking").symlink_to("/proc")  # root cannot write there either
    out = tmp_path / "out"
    command = [sys.executable, "-m", "hsslam_services.commands.hsslam", *words.split()]
    command = [str(out) if word == "OUT" else word for word in command]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: kernel cache {folder}: ")
    assert "XDG_CACHE_HOME" in line
    assert not out.exists()


def test_a_run_waits_for_no_more_kernels_than_its_poses_and_map_need(tmp_path: Path):
    """The supervisor's warm-up finds its part of the cache; the command still has the rest to compile."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    command = [
        sys.executable,
        "-c",
        "from hsslam_node.kernels.cache_folder import run_stamp as s; print(s())",
    ]
    stamp = Path(
        subprocess.run(command, env=environment, capture_output=True, text=True).stdout[:-1]
    )
    stamp.parent.mkdir(parents=True)
    stamp.touch()
    served = [sys.executable, "-m", WARM_UP, "--run", str(tmp_path)]
    info = RunInfo("run", str(tmp_path), "", "", "robot", 0, 0, ServeOptions())
    info.write()
    done = subprocess.run(served, env=environment, capture_output=True, text=True, timeout=20)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    replace(info, options=ServeOptions(grid=True)).write()
    for command, part in ((served[:-2], "the built-in room"), (served, "distances")):
        with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as rest:
            assert rest.stdout is not None and part in rest.stdout.readline()
            rest.kill()


def test_arguments_are_refused_and_help_is_given():
    assert "expected no arguments" in _warm_up("now").stderr
    help_ = _warm_up("--help")
    assert help_.returncode == 0
    assert "usage: hsslam-serve warm-up" in help_.stdout
    assert _warm_up("--version").stdout == f"hsslam-serve {__version__}\n"


@pytest.mark.e2e
def test_a_service_with_a_cold_cache_says_what_it_does_and_keeps_no_memory_without_poses(
    serve, tmp_path: Path
):
    cold = tmp_path / "cold"
    run = serve(prefix=("env", f"XDG_CACHE_HOME={cold}"))
    run.wait_until(lambda: "compiling kernels for this machine" in run.stderr, 60)
    (run.out / "trajectory.txt").mkdir()  # so that something cannot be saved
    ask(run.endpoint, "robot", STOP, Ask())
    assert run.finish() == ExitCode.NOT_SAVED, run.stderr
    assert not list(cold.glob("hsslam/kernels/*/run"))  # the stamp: no more was compiled
    assert run.summary()["stop_reason"] == "asked to stop"
    # A notice may name what another run keeps.
    assert f"hsslam-serve rescue {run.arena_dir}" not in run.stderr
    run.expect_nothing_left()


def test_ctrl_c_is_told_and_is_no_success(tmp_path: Path):
    command = [sys.executable, "-m", "hsslam_services.commands.serve", "warm-up"]
    with subprocess.Popen(
        command,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None and "compiling" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        told = process.stderr.read().splitlines()
    assert process.returncode == 1
    assert told[-1] == "warm-up interrupted: the next warm-up or run compiles the rest"
