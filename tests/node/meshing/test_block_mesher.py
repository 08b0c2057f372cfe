import numpy as np
import pytest
from trimesh.grouping import group_rows

from hsslam_node.meshing.block_mesher import BlockMesher
from hsslam_node.meshing.observed_space import ObservedSpace


def _mesher(scene, keyframes):
    mesher = BlockMesher(ObservedSpace(scene.bound, 0.03, 16))
    for depth, T in keyframes:
        mesher.observe(depth, scene.camera, T)
    return mesher


def test_growing_map_ends_as_the_one_made_at_once(scene):
    mesher = _mesher(scene, scene.keyframes[:30])
    first = mesher.update(scene.sdf, scene.color)
    assert first.blocks > 0 and first.waiting == 0
    for depth, T in scene.keyframes[30:]:
        mesher.observe(depth, scene.camera, T)
        mesher.update(scene.sdf, scene.color)
    grown = mesher.mesh()
    at_once = _mesher(scene, scene.keyframes)
    at_once.update(scene.sdf, scene.color)
    whole = at_once.mesh()
    assert len(grown.faces) == len(whole.faces)
    assert abs(grown.area - whole.area) < 1e-4


def test_only_changed_blocks_are_asked_again(scene):
    mesher = _mesher(scene, scene.keyframes)
    everything = mesher.update(scene.sdf, scene.color)
    assert mesher.update(scene.sdf, scene.color).queries == 0
    depth, T = scene.keyframes[1]
    mesher.observe(depth, scene.camera, T)
    again = mesher.update(scene.sdf, scene.color)
    assert 0 < again.blocks < everything.blocks / 2
    mesher.mark_all_changed()
    assert mesher.update(scene.sdf, scene.color).queries == everything.queries


def test_budget_leaves_the_rest_waiting(scene):
    mesher = _mesher(scene, scene.keyframes[:10])
    update = mesher.update(scene.sdf, scene.color, max_blocks=3)
    assert update.blocks == 3 and update.waiting > 0
    while update.waiting:
        update = mesher.update(scene.sdf, scene.color, max_blocks=20)
    assert len(mesher.mesh().faces) > 0


def test_blocks_of_two_map_versions_still_join(scene):
    def version(offset):  # two maps whose surfaces differ by 1.2 mm
        return lambda points: scene.sdf(points) - offset

    mesher = _mesher(scene, scene.keyframes)

    def open_edges():
        return len(group_rows(mesher.mesh().edges_sorted, require_count=1))

    mesher.update(version(0.2), scene.color)
    before = open_edges()
    mesher.mark_all_changed()
    assert mesher.update(version(0.22), scene.color, max_blocks=40).waiting > 0
    assert open_edges() == before


def test_clear_forgets_blocks_and_marks(scene):
    mesher = _mesher(scene, scene.keyframes[:5])
    mesher.update(scene.sdf, scene.color)
    mesher.clear()
    assert len(mesher.mesh().faces) == 0
    assert mesher.update(scene.sdf, scene.color).queries == 0


def test_failing_query_keeps_the_blocks_waiting(scene):
    mesher = _mesher(scene, scene.keyframes[:5])

    def fails(points):
        raise RuntimeError("map went away")

    with pytest.raises(RuntimeError):
        mesher.update(fails, scene.color)
    assert np.isfinite(mesher.update(scene.sdf, scene.color).queries)
    assert len(mesher.mesh().faces) > 0
