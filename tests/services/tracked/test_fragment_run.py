"""A run in which the camera is lost, goes on in a new map, and comes back to the old one, or does not."""

from pathlib import Path

import numpy as np
import pytest

from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import load_checkpoint, save_checkpoint
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_services.commands.maps.command import main
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.poses import logged_poses
from tests.services.serve_process import SMALL_ROOM
from tests.small_room import SMALL, pose_error

_SYNTH = SynthOptions(width_px=160, height_px=120)
_DARK = range(30, 48)  # 3 s


@pytest.mark.e2e
def test_a_fragment_joins_the_map_and_its_log_has_the_same_poses(serve):
    """Once round the room and most of the way back, in steps of five frames; the map has no room for it."""
    run = serve(
        *(*SMALL_ROOM, "--pace", "lockstep", "--stride", "5", "--to-and-fro", "2"),
        *("--frames", "246", "--cover-at", str(_DARK.start), "--cover-frames", str(len(_DARK))),
        *("--slam.keyframes.capacity", "10"),
    )
    assert run.finish(280) == 0, run.stderr
    summary = run.summary()
    fragment = summary["fragments"]["1"]
    assert fragment["joined"] and fragment["frames"] > 100
    assert "fragment 1 waits until the map has room for 3 keyframes" in run.stderr
    assert "fragment 1 has joined the map with " in run.stderr
    final = read_tum(run.out / "trajectory.txt")
    online = read_tum(run.out / "trajectory_online.txt")
    assert len(final) == summary["frames"]["tracked"] == len(online) + fragment["frames"]
    found = logged_poses(log_parts(run.out, print))
    assert len(found.online) == len(online)
    np.testing.assert_array_equal(found.final.stamps_ns, final.stamps_ns)
    np.testing.assert_allclose(found.final.T_world_cam, final.T_world_cam, atol=1e-6)


@pytest.mark.e2e
def test_a_fragment_that_does_not_join_is_saved_and_merges_with_a_run_that_saw_all(
    serve, tmp_path, capsys
):
    run = serve(
        *(*SMALL_ROOM, "--pace", "lockstep", "--stride", "6", "--frames", "66"),
        *("--cover-at", "3", "--cover-frames", "30"),
    )
    assert run.finish(120) == 0, run.stderr
    fragment = run.summary()["fragments"]["1"]
    assert not fragment["joined"] and fragment["map"] == "map_fragment_1.safetensors"
    saved = run.out / fragment["map"]
    keyframes = len(load_checkpoint(saved).keyframe_stamps_ns)
    told = f"tracker: fragment 1 has not joined the map: {saved.name} has its {keyframes} keyframes"
    assert told in run.stderr

    merged = tmp_path / "merged"
    both, T_first = _run_that_saw_all(tmp_path / "both")
    assert main(["merge", str(both), str(saved), "--out", str(merged), "--device", "cpu"]) == 0
    assert f"{saved} meets {both} in " in capsys.readouterr().out
    found = read_tum(merged / "trajectory.second.txt")
    truth = open_ground_truth("synth:room", SourceOptions(stride=6, frames=66, synth=_SYNTH))
    assert truth is not None and len(found) == fragment["frames"]
    true = truth.T_world_cam[np.searchsorted(truth.stamps_ns, found.stamps_ns)]
    poses = zip(found.T_world_cam, inverse(T_first) @ true, strict=True)
    off_m, off_deg = np.transpose([pose_error(T, true_T) for T, true_T in poses])
    assert np.median(off_m) < 0.005 and np.median(off_deg) < 0.1
    assert off_m.max() < 0.1 and off_deg.max() < 0.5


def _run_that_saw_all(folder: Path) -> tuple[Path, np.ndarray]:
    """The folder of a run with the map of other frames of the way, at their true poses, and the true pose of
    the first."""
    options = SourceOptions(start=3, stride=30, frames=13, synth=_SYNTH)
    source, truth = source_with_truth("synth:room", options)
    arrays = MemoryAllocator()
    store = KeyframeStore.create(arrays, source.camera, source.depth_units_per_m, 64)
    frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    for frame, T in zip(frames, truth.T_world_cam, strict=True):
        store.append(frame, inverse(truth.T_world_cam[0]) @ T)
    bound = initial_bound(frames[0], SMALL.bound, SMALL.mapper.max_depth_m)
    parameters = FieldParameters.create(arrays, FieldLayout.over(SMALL.field, bound), 0)
    parameters.publish()
    folder.mkdir()
    save_checkpoint(folder / "map.safetensors", map_snapshot(store, parameters, SMALL))
    return folder, truth.T_world_cam[0]
