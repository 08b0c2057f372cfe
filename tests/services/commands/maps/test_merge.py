"""`hsslam-map merge`: two sessions in the small room become one run folder, or are refused."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.merging import merge_maps
from hsslam_node.presets import REALTIME
from hsslam_services.commands.maps.command import main
from tests.small_room import pose_error
from tests.two_sessions import FIRST, SECOND, saved_session, walk

_LEVEL = RobotFrames.mounted((0.1, 0.0, 0.3, -0.5, 0.5, -0.5, 0.5)).T_base_cam
_GRAVITY = Gravity((0.0, -0.6, 0.8), 0.004)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    saved_session(folder / "first", FIRST)
    saved_session(folder / "second", SECOND, level=_LEVEL, gravity=_GRAVITY, max_depth_m=6.0)
    saved_session(folder / "mirrored", SECOND, mirrored=True)
    saved_session(folder / "lookalike", SECOND, lookalike=True)
    return folder


def test_two_sessions_become_one_run(runs, tmp_path, capsys):
    out = tmp_path / "both"
    arguments = ["merge", str(runs / "first"), str(runs / "second"), "-o", str(out)]
    assert main([*arguments, "--device", "cpu"]) == 0
    told = capsys.readouterr().out
    assert f"{runs / 'second'} meets {runs / 'first'} in " in told
    assert told.endswith(f"results: {out}\n")
    frames, poses = walk()
    found = read_tum(out / "trajectory.txt")
    assert found.stamps_ns.tolist() == [frame.stamp_ns for frame in frames]
    for T, true in zip(found.T_world_cam, inverse(poses[0]) @ poses, strict=True):
        off_m, off_deg = pose_error(T, true)
        assert off_m < 0.01 and off_deg < 0.3
    second = read_tum(out / "trajectory.second.txt")
    np.testing.assert_allclose(second.T_world_cam, found.T_world_cam[SECOND], atol=1e-8)
    saved = SavedMap.open(out / "map.safetensors", "cpu")
    assert len(saved.keyframes) == len(frames)
    assert saved.checkpoint.max_depth_m == 6.0  # the smaller limit
    keyframes, order = read_tum(out / "keyframes.txt"), np.argsort(saved.keyframes.stamps_ns)
    assert np.all(np.diff(keyframes.stamps_ns) > 0)
    of_map = saved.keyframes.T_world_cam[order]
    np.testing.assert_allclose(keyframes.T_world_cam, of_map, atol=1e-8)
    T_second_first = inverse(poses[SECOND][0]) @ poses[0]
    level = saved.checkpoint.T_level_world  # the first map has none
    off_m, off_deg = pose_error(level, _LEVEL @ T_second_first)
    assert off_m < 0.02 and off_deg < 0.3
    gravity = saved.checkpoint.gravity  # nor does it know gravity
    assert gravity is not None and gravity.sigma_rad == _GRAVITY.sigma_rad
    true_up = T_second_first[:3, :3].T @ _GRAVITY.up
    np.testing.assert_allclose(gravity.up, true_up, atol=np.deg2rad(0.3))
    assert len(trimesh.load_mesh(out / "mesh.ply").faces) > 1000
    summary = json.loads((out / "summary.json").read_text())
    assert summary["merged"]["places"] >= 3 and summary["merged"]["keyframes"] == [8, 8]


def test_of_a_second_look_at_the_same_place_one_keyframe_stays(runs, tmp_path, monkeypatch):
    """The map is hardly fitted: what stays is chosen before."""
    hasty = replace(REALTIME.mapper, iterations=1, last_iterations=0)
    monkeypatch.setattr(merge_maps, "REALTIME", replace(REALTIME, mapper=hasty))
    saved_session(tmp_path / "again", FIRST)
    out = tmp_path / "both"
    arguments = ["merge", str(runs / "first"), str(tmp_path / "again"), "-o", str(out)]
    assert main([*arguments, "--device", "cpu"]) == 0
    assert json.loads((out / "summary.json").read_text())["keyframes_kept"] == 9
    assert len(SavedMap.open(out / "map.safetensors", "cpu").keyframes) == 9
    second = read_tum(out / "trajectory.second.txt")
    first = read_tum(out / "trajectory.first.txt")
    for T, same in zip(second.T_world_cam, first.T_world_cam, strict=True):
        off_m, off_deg = pose_error(T, same)
        assert off_m < 0.01 and off_deg < 0.3


def test_a_mirror_image_is_refused_and_nothing_is_written(runs, tmp_path, capsys):
    first, mirrored = runs / "first", runs / "mirrored"
    assert main(["merge", str(first), str(mirrored), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"error: {mirrored}/map.safetensors: has ")
    in_common = f"places in common with {first}/map.safetensors: expected 3 or more"
    assert told.endswith(f" {in_common}, 1 m apart or farther\n")
    assert told.count("\n") == 1 and not list(tmp_path.iterdir())


def test_a_room_with_other_pictures_is_refused_and_nothing_is_written(runs, tmp_path, capsys):
    first, lookalike = runs / "first", runs / "lookalike"
    assert main(["merge", str(first), str(lookalike), "-o", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    found = re.fullmatch(
        rf"error: {lookalike}/map.safetensors: (\d+) of (\d+) image blocks of common places show "
        rf"what {first}/map.safetensors shows: expected 85% or more, of 60 blocks or more\n",
        told,
    )
    assert found is not None, told
    assert int(found[1]) < 0.85 * int(found[2]) and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "merge: no map: expected a run folder or map.safetensors"),
        (("RUN",), "merge: no map: expected a run folder or map.safetensors"),
        (("RUN", "/nowhere"), "/nowhere: no such file: expected a map"),
        (("RUN", "RUN", "--out", "RUN"), "already exists: expected a new folder"),
        (("RUN", "RUN"), "merge: both runs are "),
        (("RUN", "RUN", "--seed", "-1"), "--seed -1: expected 0 or more"),
        (("RUN", "RUN", "--out", "/nowhere/x"), "expected a folder in a folder that exists"),
    ],
)
def test_bad_input_is_one_line_and_code_2(runs, arguments, text, capsys):
    given = [str(runs / "first") if word == "RUN" else word for word in arguments]
    assert main(["merge", *given]) == 2
    told = capsys.readouterr().err
    assert text in told and told.startswith("error: ") and told.count("\n") == 1


def test_a_folder_that_cannot_be_made_is_told_before_the_work(tmp_path, capsys):
    """The maps are none, which a merge would find first."""
    maps = [tmp_path / name for name in ("first.safetensors", "second.safetensors")]
    for path in maps:
        path.write_bytes(b"no map")
    assert main(["merge", *map(str, maps), "--out", "/proc/both"]) == 2
    told = capsys.readouterr().err
    assert "--out /proc/both: " in told and told.endswith("expected a folder that can be written\n")
