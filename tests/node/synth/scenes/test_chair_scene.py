"""The room with a chair that is carried off: it is seen, it goes unseen, it is not in the truth."""

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.geometry.se3 import inverse
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.rendering.scene_mesh import scene_mesh
from hsslam_node.synth.scenes.chair_scene import build_chair_scene, chair_scene_poses
from tests.node.synth.scenes.still_depth import still_depth

_STRIDE = 5
_OPTIONS = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), stride=_STRIDE)


@pytest.fixture(scope="module")
def frames():
    return list(open_source("synth:chair", _OPTIONS).frames())


@pytest.fixture(scope="module")
def empty() -> np.ndarray:
    """The same depth images without the chair, raw, [N, 120, 160]."""
    poses = chair_scene_poses(None, 0)[::_STRIDE]
    return still_depth("synth:chair", _OPTIONS, build_chair_scene(0), poses)


def test_it_is_seen_at_the_start_and_its_place_is_at_the_end(frames, empty):
    shown = np.array([(f.depth_raw < e).mean() for f, e in zip(frames, empty, strict=True)])
    seconds = _STRIDE * np.arange(len(frames)) / 30
    assert shown[:6].min() > 0.03
    assert (shown[seconds > 4] == 0).all()
    looks = [_holds_place(frames[0].camera, T) for T in chair_scene_poses(None, 0)[::_STRIDE]]
    assert all(looks[:6]) and all(looks[-6:])


def test_no_frame_shows_it_move(frames):
    """When it goes, and for two seconds before and after, its place is out of the picture."""
    gone_from = build_chair_scene(0).moving.gone_from
    poses = chair_scene_poses(None, 0)
    for k in range(gone_from - 60, gone_from + 60):
        assert not _holds_place(frames[0].camera, poses[k], some=True)


def test_a_longer_run_has_no_chair_on_its_second_way(frames):
    parts = build_chair_scene(0).moving
    assert parts.at(0)[0].center_m[2] > 0
    assert all(p.center_m[2] < -5 for p in parts.at(480) + parts.at(1000))


def test_the_truth_is_without_it():
    mesh = open_ground_truth("synth:chair", _OPTIONS).mesh()
    scene = build_chair_scene(0)
    assert len(mesh.vertices) == len(scene_mesh(scene.still_parts).vertices)
    low, high = scene.moving.box_m
    above_floor = low + np.array([0, 0, 0.05])  # the carpet is 1.2 cm thick
    assert not ((mesh.vertices > above_floor) & (mesh.vertices < high)).all(axis=1).any()


def _holds_place(camera, T_world_cam: np.ndarray, *, some: bool = False) -> bool:
    """Whether the upper half of the chair's place is in the picture; `some`: any part of it."""
    low, high = build_chair_scene(0).moving.box_m
    middle = (low + high) / 2
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                        for z in ((low if some else middle)[2], high[2])])  # fmt: skip
    T = inverse(T_world_cam)
    x, y, z = (corners @ T[:3, :3].T + T[:3, 3]).T
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    inside = (z > 0.1) & (u > 0) & (v > 0) & (u < camera.width_px) & (v < camera.height_px)
    return bool(inside.any() if some else inside.all())
