"""The whole algorithm on forty small frames: accurate, and the same to the bit with one seed."""

import gc
import math
import weakref
from copy import copy
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.shapes import Spheres
from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.trajectory.ate import ate
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_tracker import FragmentTracker
from hsslam_node.fragments.join_search import JoinSearch
from hsslam_node.fragments.joining import Joining
from hsslam_node.frame import Frame
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.checkpoint import load_checkpoint
from hsslam_node.presets import REALTIME
from hsslam_node.slam import Slam
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import BadFrame
from hsslam_node.tracking.tracked_frame import TrackResult
from tests.small_room import (
    OPTIONS,
    SMALL,
    displaced,
    pose_error,
    room_frames,
    room_poses,
    with_black,
)

CONFIG = replace(SMALL, ba=replace(REALTIME.ba, loss_threshold=1e-3, pose_rate=2e-4, rays=400))
HASTY = replace(
    SMALL, mapper=replace(SMALL.mapper, first_iterations=2, iterations=1, last_iterations=1)
)
"""Leaves the map as good as untrained: for tests that do not ask it."""


@cache
def _run(seed: int) -> tuple[Slam, list[TrackResult]]:
    slam = Slam(CONFIG, seed)
    return slam, list(slam.run(room_frames()))


def test_accuracy():
    slam, results = _run(0)
    assert [r.status for r in results] == ["initial"] + 39 * ["tracked"]
    stamps = np.array([f.stamp_ns for f in room_frames()])
    estimate = Trajectory(stamps, np.stack([r.T_world_cam for r in results]))
    result = ate(estimate, Trajectory(stamps, room_poses()))
    assert result.scored == 40 and result.rmse_m < 0.01
    assert slam.store and 8 <= slam.store.count <= 12
    assert all(r.map_version > 0 and r.residual_m < 0.01 for r in results[1:])


@pytest.mark.parametrize(
    ("lit", "gap"),  # a frame without depth
    [
        *(("after the first", None), ("after the first", 1), ("after the first", 6)),
        *(("from the fifth on", None), ("from the fifth on", 6)),
        *(("never", None), ("never", 1)),
        *(("until the fifth", None), ("until the fifth", 6)),
    ],
)
def test_geometry_alone_tracks_the_camera_in_the_dark(lit: str, gap: int | None):
    is_lit = {
        "after the first": lambda k: k > 0,
        "from the fifth on": lambda k: k >= 5,
        "never": lambda _: False,
        "until the fifth": lambda k: k < 5,
    }[lit]
    noise = np.random.default_rng(0)
    mapper = replace(CONFIG.mapper, first_iterations=40, iterations=2)
    slam, found = Slam(replace(CONFIG, mapper=mapper), 0), []
    for k, frame in enumerate(room_frames()[:10]):
        dark = noise.normal(2, 1.5, frame.color.shape).clip(0, 255).astype(np.uint8)
        seen = frame if is_lit(k) else replace(frame, color=dark)
        found.append(slam.process(with_black(seen) if k == gap else seen).status)
    expected = ["initial"] + 9 * ["tracked"]
    if gap is not None:
        expected[gap] = "lost"
    assert found == expected


def test_bundle_adjustment_takes_part():
    slam, _ = _run(0)
    assert slam.store and slam.store.pose_version > 0


def test_one_seed_gives_the_same_run_to_the_bit():
    """Also if the camera writes all images into the same arrays, however these lie in memory."""
    slam, results = _run(0)
    again = Slam(CONFIG, 0)
    first = room_frames()[0]
    color, depth_raw = (np.array(image, order="F") for image in (first.color, first.depth_raw))
    for result, frame in zip(results, room_frames(), strict=True):
        color[:], depth_raw[:] = frame.color, frame.depth_raw
        found = again.process(replace(frame, color=color, depth_raw=depth_raw))
        np.testing.assert_array_equal(found.T_world_cam, result.T_world_cam)
    assert slam.parameters and again.parameters and slam.store and again.store
    np.testing.assert_array_equal(again.parameters.params, slam.parameters.params)
    np.testing.assert_array_equal(again.store.poses(), slam.store.poses())


def test_its_map_can_be_asked_and_saved(tmp_path):
    slam, results = _run(0)
    eye = results[20].T_world_cam[:3, 3]
    frame, T = room_frames()[20], results[20].T_world_cam
    surface = world_points(frame.depth_m(), frame.camera, T, 8)
    found = slam.query(surface)
    assert found.known.mean() > 0.9
    assert np.nanmedian(np.abs(found.distance_m)) < 0.01
    rays = slam.raycast(np.broadcast_to(eye, surface.shape), surface - eye)
    true_m = np.linalg.norm(surface - eye, axis=1)
    assert np.median(np.abs(rays.distance_m - true_m)[rays.hit]) < 0.01
    assert slam.is_free(Spheres(eye[None], 0.05)).shape == (1,)
    slam.save(tmp_path / "map.safetensors")
    saved = SavedMap.open(tmp_path / "map.safetensors", "cpu")
    for ours, theirs in zip(found, saved.query(surface), strict=True):
        np.testing.assert_array_equal(ours, theirs)
    field, field_m = slam.render(T, from_keyframes=False)
    np.testing.assert_array_equal(field, saved.render(T, from_keyframes=False)[0])
    view, view_m = slam.render(T)
    np.testing.assert_array_equal(view_m, field_m)
    file_view = saved.render(T)[0]  # from images that the file keeps as JPEG
    assert np.abs(view.astype(int) - file_view).mean() < 2 < np.abs(view.astype(int) - field).mean()
    assert np.array_equal(slam.mesh(0.08).vertices, saved.mesh(0.08).vertices)


def test_its_trajectory_is_of_all_frames_as_refined():
    slam, results = _run(0)
    assert slam.store
    trajectory = slam.trajectory()
    assert list(trajectory.stamps_ns) == [f.stamp_ns for f in room_frames()]
    for result, T in zip(results, trajectory.T_world_cam, strict=True):
        np.testing.assert_allclose(T, slam.store.pose(result.keyframe) @ result.T_keyframe_cam)


def test_a_map_that_is_held_stays_as_it_is():
    slam = Slam(HASTY)
    for frame in room_frames()[:2]:
        slam.process(frame)
    held = slam.map
    points = np.random.default_rng(0).uniform((-0.5, -0.5, 1.0), (0.5, 0.5, 2.0), (500, 3))
    before = copy(held).query(points)
    for frame in room_frames()[2:14]:
        slam.process(frame)
    newer = slam.query(points)
    for then, now in zip(before, held.query(points), strict=True):
        np.testing.assert_array_equal(now, then)
    assert slam.map is not held and slam.map is slam.map
    assert (newer.distance_m != before.distance_m).any()
    assert (newer.certainty > before.certainty).any()


def test_a_fragment_that_joins_after_the_last_frame_is_adjusted():
    graph = replace(HASTY.pose_graph, loop_gap=3, aligned_every=1)
    ba = replace(HASTY.ba, every_keyframes=1000)
    slam = Slam(replace(HASTY, ba=ba, pose_graph=graph))
    frames, right = room_frames(), room_poses()
    for frame in frames[:13]:
        slam.process(frame)
    tracker, store = slam._tracker, slam.store
    assert isinstance(tracker, FragmentTracker) and store and store.count == 4
    fragment = Fragment(CONFIG, frames[5], 0, 1, 8)
    fragment.track(frames[5])
    tracker._joining = Joining(
        fragment,
        store,
        FragmentPlace(displaced(right[5], 0.02, 1.0), np.zeros(3)),
        tracker._note_join,
    )
    slam.finish()
    assert store.count == 5 and pose_error(store.pose(4), right[5])[0] < 0.005


def test_a_fragment_that_does_not_join_is_saved_if_a_folder_is_given(tmp_path):
    """The camera goes through a dark door into another building."""
    room = room_frames()[:4]
    options = SourceOptions(stride=6, frames=12, synth=SynthOptions(width_px=160, height_px=120))
    other = [f for f in open_source("synth:apartment", options).frames() if isinstance(f, Frame)]
    last_ns, step_ns = room[-1].stamp_ns, 200_000_000
    dark = [with_black(room[-1], stamp_ns=last_ns + k * step_ns) for k in range(1, 6)]
    after = [replace(f, stamp_ns=last_ns + (6 + k) * step_ns) for k, f in enumerate(other)]
    for folder in (None, tmp_path / "run", tmp_path / "run"):
        slam = Slam(HASTY, new_map_after_s=1.0, fragments=folder)
        for frame in (*room, *dark, *after):
            slam.process(frame)
        slam.finish()
    paths = sorted((tmp_path / "run").iterdir())
    assert [path.name for path in paths] == [f"map_fragment_{n}.safetensors" for n in (1, 2)]
    for saved in map(load_checkpoint, paths):
        assert not saved.is_fitted and saved.keyframe_stamps_ns[0] >= after[0].stamp_ns


def test_a_fragment_that_cannot_be_saved_ends_neither_the_frame_nor_the_map(tmp_path):
    slam = Slam(HASTY, fragments=tmp_path / "run")
    for frame in room_frames()[:4]:
        slam.process(frame)
    tracker, store, parameters = slam._tracker, slam.store, slam.parameters
    assert isinstance(tracker, FragmentTracker) and store and parameters
    fragment = Fragment(HASTY, room_frames()[4], 0, 1, 8)
    fragment.track(room_frames()[4])
    tracker._fragment = fragment
    tracker._search = JoinSearch(store, tracker._map.places, fragment)
    (tmp_path / "run").rmdir()
    slam.localise_only = True  # so that the tracker leaves the fragment
    assert slam.process(room_frames()[4]).status == "tracked"
    assert len(slam.trajectory()) == 5
    slam.localise_only, version = False, parameters.version
    told = r"fragment 1 not saved: .*run/map_fragment_1.safetensors: .*No such file"
    with pytest.raises(UserError, match=told):
        slam.finish()
    assert parameters.version > version
    slam.finish()  # does not raise the error again


def test_the_memory_of_a_deleted_run_is_free_at_once(tmp_path):
    """Python's search for cycles does not count the bytes of arrays, so it may come much later."""
    gc.disable()
    try:
        slam = Slam(HASTY, fragments=tmp_path)
        for frame in room_frames()[:2]:
            slam.process(frame)
        slam.render(np.eye(4))
        assert slam.store and slam.parameters
        parts = [
            weakref.ref(part) for part in (slam, slam.store, slam.parameters, slam.map.keyframes)
        ]
        del slam
        assert [part() for part in parts] == [None] * 4
    finally:
        gc.enable()


def test_a_result_whose_arrays_are_overwritten_does_not_mislead_the_tracker():
    expected = [result.T_world_cam for result in Slam(HASTY).run(room_frames()[:6])]
    found = []
    for result in Slam(HASTY).run(room_frames()[:6]):
        found.append(result.T_world_cam.copy())
        for array in (result.T_world_cam, result.T_keyframe_cam, result.covariance):
            if array is not None:
                array[:3, 1:3] *= -1
    np.testing.assert_array_equal(found, expected)


def test_a_folder_of_fragments_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match=r"fragments = .*/file: File exists: expected a folder"):
        Slam(SMALL, fragments=tmp_path / "file")


@pytest.mark.parametrize(
    "given",
    [
        {"new_map_after_s": -1.0},
        {"new_map_after_s": math.nan},
        {"new_map_after_s": "3"},
        {"seed": -1},
        {"seed": True},
        {"seed": 1.0},
    ],
)
def test_numbers_out_of_range_are_named(given):
    (name,) = given
    with pytest.raises(UserError, match=rf"{name} = .*: expected .*0 or more"):
        Slam(SMALL, **given)


def test_the_name_of_a_preset_is_no_configuration():
    with pytest.raises(UserError, match=r"config = 'realtime': expected a SlamConfig, as PRESETS"):
        Slam("realtime")  # type: ignore[arg-type]


def test_what_is_no_frame_is_named():
    with pytest.raises(UserError, match="frame is a NoneType: expected a Frame"):
        Slam(SMALL).process(None)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="frame is a int: expected a Frame"):
        next(Slam(SMALL).run([1, 2]))  # type: ignore[list-item]


def test_a_whole_number_of_numpy_is_a_seed():
    assert Slam(SMALL, seed=np.int64(3)).seed == 3


def test_without_a_frame_there_is_no_map():
    slam = Slam(SMALL)
    with pytest.raises(UserError, match="there is no map yet: expected a first keyframe"):
        slam.query(np.zeros((1, 3)))
    assert len(slam.trajectory()) == 0


def test_frames_that_cannot_be_read_are_left_out_and_listed():
    frames, slam = room_frames(), Slam(HASTY)
    bad = BadFrame(1, frames[1].stamp_ns, "rgb/1.png: truncated at 50 bytes")
    results = list(slam.run([frames[0], bad, frames[2]]))
    assert [(r.frame_index, r.status) for r in results] == [(0, "initial"), (2, "tracked")]
    assert slam.bad_frames == [bad]


def test_frames_without_depth_at_the_start_are_waited_out():
    slam, frames = Slam(HASTY), room_frames()
    assert slam.process(with_black(frames[0])).status == "lost"
    assert slam.parameters is None
    assert slam.process(frames[1]).status == "initial"
    assert slam.parameters is not None and slam.parameters.version == 1


def test_a_map_begins_with_a_frame_that_has_depth_for_it():
    """The tracker takes depth up to 6 m, the map here only up to 1 m."""
    near = replace(HASTY, mapper=replace(HASTY.mapper, max_depth_m=1.0))
    slam, first = Slam(near), room_frames()[0]
    assert first.depth_m()[first.depth_raw > 0].min() > 1.0
    assert slam.process(first).status == "lost" and slam.parameters is None
    close = replace(first, stamp_ns=first.stamp_ns + 1, depth_raw=first.depth_raw // 4)
    assert slam.process(close).status == "initial"
    assert slam.parameters is not None and slam.parameters.version == 1


def test_a_camera_that_moved_unseen_is_lost_or_right():
    """Places the map says nothing of must not be taken for places it knows."""
    options = replace(OPTIONS, frames=6, stride=45)
    truth = open_ground_truth("synth:room", options)
    assert truth
    poses = inverse(truth.T_world_cam[0]) @ truth.T_world_cam
    frames = [f for f in open_source("synth:room", options).frames() if isinstance(f, Frame)]
    results = list(Slam(SMALL).run(frames))
    assert any(result.status == "lost" for result in results)
    for result, pose in zip(results, poses, strict=True):
        if result.status != "lost":
            distance_m, angle_deg = pose_error(result.T_world_cam, pose)
            assert distance_m < 0.1 and angle_deg < 5.0
