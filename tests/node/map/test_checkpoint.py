import json
import os
import struct
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save_file

from hsslam_node.config import FieldConfig
from hsslam_node.errors import UserError
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint, save_checkpoint
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout


@pytest.fixture
def checkpoint():
    config = FieldConfig(plane_channels=16, hash_levels=4, hash_table_log2=9)
    layout = FieldLayout.over(config, Bound((-0.51, 0.1, 0.2), (0.5, 0.8, 0.9)))
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, 3] = np.random.default_rng(0).random((3, 3))
    return MapCheckpoint(layout, initial_parameters(layout, 1), np.array([5, 6, 7]) * 10**18, poses)


@pytest.fixture
def saved(checkpoint, tmp_path):
    path = tmp_path / "map.safetensors"
    save_checkpoint(path, checkpoint)
    return path


def test_a_map_that_was_saved_is_whole_after_a_power_cut(checkpoint, disk):
    save_checkpoint(disk.folder / "map.safetensors", checkpoint)
    loaded = load_checkpoint(disk.cut() / "map.safetensors")
    np.testing.assert_array_equal(loaded.params, checkpoint.params)


def test_what_was_saved_is_loaded(checkpoint, saved):
    loaded = load_checkpoint(saved)
    assert loaded.layout == checkpoint.layout
    for name in ("params", "keyframe_stamps_ns", "T_world_keyframe"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(checkpoint, name))
    assert [p.name for p in saved.parent.iterdir()] == [saved.name]


def test_the_same_map_is_the_same_file(checkpoint, saved):
    before = saved.read_bytes()
    save_checkpoint(saved, checkpoint)
    assert saved.read_bytes() == before


def test_the_robot_that_made_a_map_is_kept(checkpoint, saved):
    assert load_checkpoint(saved).T_level_world is None
    level = RobotFrames.mounted((0.3, 0.1, 0.35, 0.1, 0.7, 0.1, 0.7)).T_base_cam
    save_checkpoint(saved, replace(checkpoint, T_level_world=level))
    np.testing.assert_array_equal(load_checkpoint(saved).T_level_world, level)
    _rewrite_metadata(saved, version="1", T_level_world="[1, 2]")  # no checksum then
    with pytest.raises(UserError, match="damaged map: T_level_world"):
        load_checkpoint(saved)


def test_how_unsure_the_way_to_each_keyframe_is_is_kept(checkpoint, saved):
    assert not load_checkpoint(saved).gap_covariance(0).any()
    n = len(checkpoint.keyframe_stamps_ns)
    gaps = np.random.default_rng(0).random((n, 6, 6))
    save_checkpoint(saved, replace(checkpoint, keyframe_gaps=gaps))
    np.testing.assert_array_equal(load_checkpoint(saved).gap_covariance(n - 1), gaps[-1])


def test_the_folder_of_a_run_is_its_map(checkpoint, saved):
    assert load_checkpoint(saved.parent).layout == checkpoint.layout
    saved.unlink()
    with pytest.raises(UserError, match=r"/map.safetensors: no such file: expected a map"):
        load_checkpoint(saved.parent)


def test_a_map_that_has_grown_is_loaded(checkpoint, tmp_path):
    layout = checkpoint.layout.grown(Bound((-1.0, 0.1, 0.2), (0.5, 1.2, 0.9)))
    grown = replace(checkpoint, layout=layout, params=initial_parameters(layout, 2))
    save_checkpoint(tmp_path / "map.safetensors", grown)
    loaded = load_checkpoint(tmp_path / "map.safetensors")
    assert loaded.layout == layout
    np.testing.assert_array_equal(loaded.params, grown.params)


def test_a_map_from_before_bounds_could_grow_is_loaded(checkpoint, saved):
    _rewrite_metadata(saved, version="1", first_bound="null")  # no checksum then
    assert load_checkpoint(saved).layout == checkpoint.layout


def test_missing_file_is_told(tmp_path):
    with pytest.raises(UserError, match="no such file"):
        load_checkpoint(tmp_path / "map.safetensors")
    with pytest.raises(UserError, match="File name too long: expected a map to read"):
        load_checkpoint(tmp_path / ("m" * 300))


@pytest.mark.parametrize(
    ("kept", "text"),
    [(0, "not a map"), (4, "not a map"), (100, "damaged map"), (-1, "damaged map")],
)
def test_truncated_file_is_told(saved, kept, text):
    saved.write_bytes(saved.read_bytes()[:kept])
    with pytest.raises(UserError, match=text):
        load_checkpoint(saved)


def test_a_map_that_this_user_may_not_read_is_not_called_damaged(checkpoint):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.safetensors"
        save_checkpoint(path, checkpoint)
        path.chmod(0)
        Path(folder).chmod(0o755)
        me = os.geteuid()
        if me == 0:
            os.seteuid(65534)
        try:
            with pytest.raises(
                UserError, match=r"safetensors: Permission denied: expected a map to read"
            ):
                load_checkpoint(path)
        finally:
            os.seteuid(me)


def test_garbage_is_told(saved):
    saved.write_bytes(b"\x80\x04pickle" * 100)
    with pytest.raises(UserError, match="not a map"):
        load_checkpoint(saved)


def _rewrite_metadata(path, **changes):
    raw = path.read_bytes()
    (length,) = struct.unpack("<Q", raw[:8])
    header = json.loads(raw[8 : 8 + length])
    header["__metadata__"].update(changes)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + raw[8 + length :])


def test_another_version_is_refused(saved):
    _rewrite_metadata(saved, version="4")
    with pytest.raises(UserError, match="map version 4: expected 1 to 3"):
        load_checkpoint(saved)


def test_another_format_is_refused(tmp_path):
    path = tmp_path / "other.safetensors"
    save_file({"a": np.zeros(3)}, path)
    with pytest.raises(UserError, match="expected a hsslam-map file"):
        load_checkpoint(path)


def test_a_flipped_bit_is_told(saved):
    raw = bytearray(saved.read_bytes())
    raw[-100] ^= 1
    saved.write_bytes(raw)
    with pytest.raises(UserError, match="damaged map: its checksum is wrong"):
        load_checkpoint(saved)


def test_unknown_option_names_the_nearest(saved, checkpoint):
    _rewrite_metadata(saved, version="2", field=json.dumps({"plane_chanels": 16}))
    with pytest.raises(UserError, match="did you mean plane_channels"):
        load_checkpoint(saved)


@pytest.mark.parametrize("value", [0.0, np.nan, 1e300, 2.0, -1.0])
def test_a_keyframe_without_a_pose_is_told(checkpoint, saved, value):
    poses = checkpoint.T_world_keyframe.copy()
    poses[1, 0, 0] = value
    save_checkpoint(saved, replace(checkpoint, T_world_keyframe=poses))
    with pytest.raises(
        UserError, match=r"map\.safetensors: damaged map: T_world_keyframe has a ma"
    ):
        load_checkpoint(saved)


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("max_depth_m", '"a"', "max_depth_m = 'a', not metres above 0"),
        ("max_depth_m", "-1", "max_depth_m = -1, not metres above 0"),
        ("max_depth_m", "NaN", "max_depth_m = nan, not metres above 0"),
        ("field", '{"plane_channels": -3}', "plane_channels"),
        ("bound", "[[1, 1, 1], [0, 0, 0]]", "expected"),
        ("camera", "[" * 100_000, "maximum recursion depth"),
    ],
)
def test_metadata_that_cannot_be_used_are_told(saved, name, text, problem):
    _rewrite_metadata(saved, version="2", **{name: text})
    with pytest.raises(UserError, match=r"map\.safetensors: damaged map: ") as told:
        load_checkpoint(saved)
    assert problem in str(told.value)


def test_tensors_of_another_size_are_told(saved):
    _rewrite_metadata(saved, version="2", bound=json.dumps([[-0.51, 0.1, 0.2], [5.0, 0.8, 0.9]]))
    with pytest.raises(UserError, match="damaged map: field/"):
        load_checkpoint(saved)


def test_unwritable_place_is_told(checkpoint, tmp_path):
    with pytest.raises(UserError, match="cannot write the map"):
        save_checkpoint(tmp_path / "nowhere" / "map.safetensors", checkpoint)
