"""Options: presets give the defaults, and every mistake is one line that suggests the nearest."""

import subprocess
import sys

import pytest

from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS
from hsslam_services.commands.serve_command_line import parse_command_line


def test_defaults_are_the_realtime_preset_on_the_built_in_room():
    options = parse_command_line([])
    assert options.source == "synth:room"
    assert options.slam == PRESETS["realtime"]


def test_an_option_overrides_the_preset_that_it_stands_beside():
    options = parse_command_line(["--slam.tracker.points", "1000", "--preset=paper"])
    assert options.slam.tracker.points == 1000
    assert options.slam.mapper == PRESETS["paper"].mapper
    options = parse_command_line(["--slam.mapper.window-keyframes", "7", "--synth.length", "99"])
    assert options.slam.mapper.window_keyframes == 7
    assert options.source_options.synth.length == 99


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            "--preset papr",
            "paper or eslam or co-slam; did you mean paper?",
        ),
        ("--sorce x", "--sorce: unknown option; did you mean --source?"),
        ("--tracker.points 3", "--tracker.points: unknown option; did you mean --slam.tracker.po"),
        ("--points 3", "--points: unknown option; did you mean --slam.tracker.points?"),
        ("warmup", "warmup: expected options; did you mean warm-up?"),
        ("rescu runs/x", "rescu: expected options; did you mean rescue?"),
        ("desk", "desk: expected an option, as --source SOURCE"),
        ("--pace fast", "--pace"),
        ("--slam.tracker.points q", "--slam.tracker.points q: expected a whole number"),
        ("--frames many", "--frames many: expected a whole number"),
        ("--rate-hz often", "--rate-hz often: expected a number"),
        ("--synth.rate-hz often", "--synth.rate-hz often: expected a number"),
        ("--zzzzzz 3", "--zzzzzz: unknown option; see hsslam-serve --help"),
        ("--slam.tracker.points -5", "tracker.points = -5: expected"),
        ("--frames", "--frames: missing value: expected --frames N"),
        ("--config", "--config: missing value: expected --config FILE..."),
        ("--synth.size-m 5", "--synth.size-m: missing value: expected --synth.size-m X X X"),
        (
            "--slam.field.plane-channels 17",
            "--slam.field.plane-channels 17: expected 0 or 16 or 32",
        ),
        (
            "--source zenoh: --mask a.png",
            "--mask a.png: another program sends the frames (--source zenoh:): set",
        ),
        (
            "--source zenoh: --downscale 2",
            "--downscale 2: another program sends the frames (--source zenoh:): choose or change",
        ),
        ("--source zenoh: --hold-frames 9", "--hold-frames 9: another program sends the frames"),
        ("--source zenoh: --frames 30", "--frames 30: another program sends the frames"),
        ("--source zenoh: --noise kinect", "--noise kinect: another program sends the frames"),
        ("--source zenoh: --camera.fx 9", "--camera.fx 9.0: source zenoh: has its own camera"),
        ("--viewer connect:laptop", "--viewer connect:laptop: expected connect:HOST:PORT"),
        ("--viewer vlc", "--viewer vlc: expected auto, none, web, spawn or connect:URL"),
        ("--viewer-memory-gb 0", "--viewer-memory-gb 0.0: expected GB, 0.1 or more"),
        ("--viewer-memory-gb nan", "--viewer-memory-gb nan: expected GB, 0.1 or more"),
        ("--robot a/b", "--robot 'a/b': expected letters"),
        ("--zenoh-port 99999", "--zenoh-port 99999: expected 1 to 65535"),
        ("--rate-hz nan", "--rate-hz nan: expected 0.01 to 10000"),
        ("--frames 0", "--frames 0: expected 1 or more"),
        ("--cover-at 5", "--cover-at 5: expected with --cover-frames"),
        ("--hold-at 5", "--hold-at 5: expected with --hold-frames"),
    ],
)
def test_a_mistake_is_one_line(line: str, expected: str):
    with pytest.raises(UserError) as caught:
        parse_command_line(line.split())
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_command_prints_help_and_version_and_exits_with_2_on_a_mistake():
    def run(*args: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "hsslam_services.commands.serve", *args]
        return subprocess.run(command, capture_output=True, text=True)

    shown, everything = run("--help"), run("--help-all")
    assert shown.returncode == everything.returncode == 0
    assert "--source SOURCE" in shown.stdout and "--camera.fx" in shown.stdout
    assert "--slam" not in shown.stdout.replace("all --slam options", "")
    assert "--slam.tracker.points N" in everything.stdout and "[paper]" not in everything.stdout
    assert "[2000]" in run("--preset", "paper", "--help-all").stdout
    assert run("--version").stdout.startswith("hsslam-serve 0.")
    wrong = run("--preset", "fast")
    assert wrong.returncode == 2
    assert wrong.stderr == "error: --preset fast: expected realtime or paper or eslam or co-slam\n"
