"""Options from files: what a run writes gives the same options, and every mistake names the file."""

import dataclasses
import tomllib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS
from hsslam_node.sources.tum import _FREIBURG_CAMERAS
from hsslam_services.commands.options.config_file import camera_names
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.config_file import config_text
from hsslam_services.run.options import ServeOptions

_ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20)
_FLOATS = st.floats(1e-9, 1e9)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    preset=st.sampled_from(list(PRESETS)),
    texts=st.tuples(_ANY_TEXT, _ANY_TEXT),
    rate_hz=st.none() | st.floats(0.01, 10_000),
    frames=st.none() | st.integers(1, 10**9),
    fx=st.none() | _FLOATS,
    distortion=st.just(()) | st.tuples(*[st.floats(-10, 10)] * 4),
    gaps=st.lists(st.integers(1, 99), max_size=3).map(tuple),
    threshold=_FLOATS,
    on=st.booleans(),
)
def test_options_to_toml_and_back(
    tmp_path, preset, texts, rate_hz, frames, fx, distortion, gaps, threshold, on
):
    slam = PRESETS[preset]
    options = ServeOptions(
        preset=preset,
        source=texts[0],
        maps=texts[1],
        rate_hz=rate_hz,
        frames=frames,
        evaluate=on,
        camera=dataclasses.replace(ServeOptions().camera, fx=fx, distortion=distortion),
        slam=dataclasses.replace(
            slam,
            ba=dataclasses.replace(slam.ba, loss_threshold=threshold, enabled=on),
            pose_graph=dataclasses.replace(slam.pose_graph, neighbours=gaps),
        ),
        out="runs/not-repeated",
        config=("camera:kinect-v1",),
    )
    path = tmp_path / "config.toml"
    path.write_text(config_text(options), encoding="utf-8")
    for place in (str(path), str(tmp_path)):
        found = parse_command_line(["--config", place])
        assert found == dataclasses.replace(options, out="", config=(place,))


def test_the_command_line_wins_over_files_and_a_later_file_over_an_earlier_one(tmp_path: Path):
    first, second = tmp_path / "first.toml", tmp_path / "second.toml"
    first.write_text('pace = "lockstep"\nseed = 1\nframes = 5\n[slam.tracker]\npoints = 500\n')
    second.write_text("seed = 2\nframes = 6\nlog-part-mb = 3\n")
    for line in (f"--config {first} {second}", f"--config {first} --config={second}"):
        options = parse_command_line([*line.split(), "--frames", "7", "--preset", "paper"])
        assert (options.pace, options.seed, options.frames) == ("lockstep", 2, 7)
        assert options.log_part_mb == 3
        assert options.slam.tracker.points == 500
        assert options.slam.mapper == PRESETS["paper"].mapper
        assert options.config == (str(first), str(second))
    assert parse_command_line(["--config", str(first), "--frames", "none"]).frames is None


def test_options_that_belong_together_may_come_from_two_places(tmp_path: Path):
    path = tmp_path / "a.toml"
    path.write_text("localise_only = true\n")
    assert parse_command_line(["--config", str(path), "--map", "m"]).localise_only
    with pytest.raises(UserError, match=r"a\.toml: --localise-only: expected --map NAME too"):
        parse_command_line(["--config", str(path)])


def test_a_preset_that_a_file_is_not_for_is_one_line(tmp_path: Path):
    (tmp_path / "config.toml").write_text(config_text(ServeOptions()))
    with pytest.raises(UserError, match=r"--preset paper: .*config\.toml is for preset realtime"):
        parse_command_line(["--config", str(tmp_path), "--preset", "paper"])
    assert parse_command_line(["--config", str(tmp_path), "--preset", "realtime"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pase = 1", "pase = 1: unknown option; did you mean pace?"),
        ("[slam.tracker]\npints = 1", "slam.tracker.pints = 1: unknown option; did you mean sl"),
        ("points = 1", "points = 1: unknown option; did you mean slam.tracker.points?"),
        ("[slm.tracker]\npoints = 1", "[slm]: unknown option"),
        ("frames = 'many'", 'frames = "many": expected a whole number'),
        ("frames = 1.5", "frames = 1.5: expected a whole number"),
        ("rate_hz = true", "rate_hz = true: expected a number"),
        ("evaluate = 1", "evaluate = 1: expected true or false"),
        ("pace = 'locstep'", "expected realtime or lockstep; did you mean lockstep?"),
        ("[synth]\nsize_m = [1, 2]", "synth.size_m = [1, 2]: expected a list of 3: a number"),
        ("[slam.tracker]\npoints = -5", "tracker.points = -5: expected 100 to 10000000"),
        ("seed = 1\nseed", "expected TOML"),
        ("config = ['other.toml']", "config = ['other.toml']: unknown option"),
        ("log_keep = 0.001", "--log-keep 0.001: expected at least 0.01 GB, or 0 to keep all"),
        (f"seed = {5000 * '9'}", "a number is too long, or brackets are too deep: expected TOML"),
        (f"seed = {3000 * '['}{3000 * ']'}", "brackets are too deep: expected TOML"),
    ],
)
def test_a_mistake_in_a_file_is_one_line_that_names_it(tmp_path: Path, text: str, message: str):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        parse_command_line(["--config", str(path)])
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("/nowhere.toml", "--config /nowhere.toml: No such file"),
        ("camera:kinect-v2", "did you mean kinect-v1?"),
    ],
)
def test_a_file_that_is_not_there_is_one_line(place: str, message: str):
    with pytest.raises(UserError) as caught:
        parse_command_line(["--config", place])
    assert message in str(caught.value)


def test_a_folder_without_a_config_is_one_line(tmp_path: Path):
    with pytest.raises(UserError, match=r"config\.toml: No such file.*expected a TOML file"):
        parse_command_line(["--config", str(tmp_path)])


def test_camera_presets_are_cameras_and_the_published_ones():
    found = {
        name: parse_command_line(["--config", f"camera:{name}"]).camera for name in camera_names()
    }
    assert {"kinect-v1", "tum-fr1", "tum-fr2", "tum-fr3"} == set(found)
    assert all(camera.fx and camera.depth_scale for camera in found.values())
    for number, camera in _FREIBURG_CAMERAS.items():
        ours = found[f"tum-fr{number}"]
        assert (ours.fx, ours.fy, ours.cx, ours.cy) == (camera.fx, camera.fy, camera.cx, camera.cy)
        assert (ours.distortion or (0.0,) * 5) == tuple(camera.distortion or (0.0,) * 5)


def test_a_byte_order_mark_is_left_out(tmp_path: Path):
    path = tmp_path / "mine.toml"
    path.write_text("seed = 7\n", encoding="utf-8-sig")
    assert parse_command_line(["--config", str(path)]).seed == 7


def test_a_value_of_a_camera_preset_can_be_changed():
    line = "--config camera:kinect-v1 --camera.depth-scale 5000"
    camera = parse_command_line(line.split()).camera
    assert (camera.fx, camera.depth_scale) == (525.0, 5000.0)


def test_the_file_is_plain_toml():
    document = tomllib.loads(config_text(ServeOptions(frames=3)))
    assert document["frames"] == 3
    assert document["slam"]["tracker"]["points"] == 2000
    assert "out" not in document and "rate_hz" not in document
