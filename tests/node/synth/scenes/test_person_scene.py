"""The room with somebody in it: he is seen, he is not in the truth."""

import numpy as np
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.rendering.scene_mesh import scene_mesh
from hsslam_node.synth.scenes.person_scene import build_person_scene, person_scene_poses
from tests.node.synth.scenes.still_depth import still_depth

_STRIDE = 10
_OPTIONS = SourceOptions(synth=SynthOptions(width_px=160, height_px=120), stride=_STRIDE)


@pytest.fixture(scope="module")
def frames():
    return list(open_source("synth:person", _OPTIONS).frames())


@pytest.fixture(scope="module")
def hidden(frames) -> np.ndarray:
    """Share of every picture that the person hides, [N]: what is nearer than without him."""
    poses = person_scene_poses(None, 0)[: _STRIDE * len(frames) : _STRIDE]
    empty = still_depth("synth:person", _OPTIONS, build_person_scene(0), poses)
    shares = []
    for frame, depth in zip(frames, empty, strict=True):
        shares.append((frame.depth_raw < depth).mean())
        assert (frame.depth_raw <= depth).all()
    return np.array(shares)


def test_he_hides_up_to_forty_percent_for_a_while(hidden):
    assert 0.30 < hidden.max() < 0.48
    assert (hidden > 0.15).sum() * _STRIDE > 60  # frames: two seconds of the twenty


def test_he_comes_and_goes(hidden):
    assert (hidden[:3] == 0).all()  # the map begins without him
    assert (hidden == 0).mean() > 0.2
    passes = np.flatnonzero(np.diff((hidden > 0.02).astype(int)) == 1)
    assert len(passes) >= 2


def test_depth_and_color_show_him(frames, hidden):
    k = int(hidden.argmax())
    assert frames[k].depth_m().min() < 1.6
    assert np.abs(frames[k].color.astype(int) - frames[k - 2].color).mean() > 15


def test_the_truth_is_without_him():
    mesh = open_ground_truth("synth:person", _OPTIONS).mesh()
    scene = build_person_scene(0)
    assert len(mesh.vertices) == len(scene_mesh(scene.still_parts).vertices)
    assert len(scene.parts_at(0)) > len(scene.still_parts)


def test_two_runs_are_the_same(frames):
    for frame, again in zip(frames[:12:4], list(open_source("synth:person", _OPTIONS).frames())[:12:4],
                            strict=True):  # fmt: skip
        np.testing.assert_array_equal(frame.color, again.color)
        np.testing.assert_array_equal(frame.depth_raw, again.depth_raw)
