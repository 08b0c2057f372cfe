import numpy as np
import pytest

from hsslam_node.geometry.bound import Bound
from hsslam_node.meshing.extract_mesh import extract_mesh
from hsslam_node.meshing.live_mesh import LiveMesh
from hsslam_node.meshing.marked_keyframes import MarkedKeyframes
from hsslam_node.meshing.sparse_space import SparseSpace
from tests.node.meshing.conftest import TRUNCATION_M


def _always() -> bool:
    return True


class _Live:
    """A live mesh of the first keyframes of a scene."""

    def __init__(self, scene, count: int) -> None:
        self.scene = scene
        self.mesh = LiveMesh(SparseSpace(0.03, 16), TRUNCATION_M)
        self.marked = MarkedKeyframes(self.mesh)
        self.marked.cover(scene.bound)
        self.poses = np.array([T for _, T in scene.keyframes])
        self.mark(count)

    def mark(self, count: int) -> None:
        depth_m = lambda k: self.scene.keyframes[k][0]  # noqa: E731
        kept = dict(enumerate(self.poses[:count]))
        self.marked.mark(kept, self.scene.camera, depth_m, _always)

    def refresh(self, sdf=None, has_time=_always):
        sdf = sdf or self.scene.sdf
        self.mesh.probe(sdf, has_time)
        return self.mesh.refresh(sdf, self.scene.color, has_time)

    def area(self) -> float:
        total = 0.0
        for part in self.mesh.meshes:
            a, b, c = (part.vertices[part.faces[:, k]] * self.mesh.space.voxel_m for k in range(3))
            total += 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        return total


@pytest.fixture
def live(scene):
    return _Live(scene, 60)


def test_blocks_grown_bit_by_bit_are_the_surface_of_the_final_mesh(scene, live):
    live.refresh()
    for count in range(70, len(scene.keyframes) + 10, 10):
        live.mark(count)
        live.refresh()
    whole = extract_mesh(
        scene.sdf, scene.color, scene.bound, scene.camera, scene.keyframes, stride_px=2
    )
    assert live.area() == pytest.approx(whole.area, rel=0.01)


def test_keyframes_that_are_retired_meanwhile_mark_nothing(scene):
    live = _Live(scene, 0)
    none = lambda _: None  # noqa: E731
    live.marked.mark(dict(enumerate(live.poses[:60])), scene.camera, none, _always)
    assert not live.marked.is_behind and not live.refresh().changed
    live.mark(len(live.poses))
    assert live.refresh().changed  # of those behind


def test_the_marks_of_a_long_run_take_time_for_its_kept_keyframes_alone(scene):
    live = _Live(scene, 0)
    kept = {10_000 * k: T for k, T in enumerate(live.poses[:8])}  # the others are retired
    rests = []
    has_time = lambda: rests.append(1) or True  # noqa: E731
    depth_m = lambda k: scene.keyframes[k // 10_000][0]  # noqa: E731
    live.marked.mark(kept, scene.camera, depth_m, has_time)
    assert len(rests) == 7 and not live.marked.is_behind
    del kept[10_000], kept[30_000]
    T_shift = np.eye(4)
    T_shift[0, 3] = 0.3
    loop = {k: T_shift @ T for k, T in kept.items()}
    live.marked.mark(loop, scene.camera, depth_m, has_time)
    assert len(rests) == 12 and not live.marked.is_behind  # all six are marked again
    live.marked.mark(loop, scene.camera, depth_m, has_time)
    assert len(rests) == 12


def test_nothing_changes_while_the_map_stands_still(scene, live):
    assert len(live.refresh().changed) > 50
    live.mark(60)
    again = live.refresh()
    assert not again.changed and again.waiting == 0
    assert again.asked <= 0.05 * len(live.mesh.meshes) + 1  # in turn


def test_only_blocks_whose_surface_moved_change(scene, live):
    live.refresh()

    def dented(points):  # 12 mm nearer on one side of the room
        return scene.sdf(points) - 0.2 * (points[:, 0] > 1.2)

    changed = live.refresh(dented).changed
    size_m = live.mesh.space.block_m
    assert 0 < len(changed) < len(live.mesh.meshes) / 2
    assert all((block[0] + 1) * size_m > 1.2 for block in changed)


def test_a_surface_that_goes_is_told(scene, live):
    live.refresh()
    blocks = {mesh.block for mesh in live.mesh.meshes}
    changed = live.refresh(lambda points: np.ones(len(points), np.float32)).changed
    assert changed.keys() == blocks and not any(changed.values())
    assert not live.mesh.meshes


def test_little_time_leaves_blocks_waiting_and_all_come_in_turn(scene, live):
    first = live.refresh(has_time=lambda: False)
    assert first.asked == 1 and first.waiting > 0
    for _ in range(1000):
        if live.refresh(has_time=iter([True] * 40 + [False] * 2000).__next__).waiting == 0:
            break
    at_once = _Live(scene, 60)
    at_once.refresh()
    assert live.area() == pytest.approx(at_once.area(), rel=1e-3)


def test_marks_follow_keyframes_that_a_loop_has_moved(scene, live):
    live.refresh()
    T_shift = np.eye(4)
    T_shift[0, 3] = 0.3
    live.poses = T_shift @ live.poses
    moved = lambda points: scene.sdf(points - np.array([0.3, 0, 0], np.float32))  # noqa: E731
    live.mark(60)
    live.refresh(moved)
    fresh = _Live(scene, 60)
    fresh.refresh()
    assert live.area() == pytest.approx(fresh.area(), rel=0.02)
    assert max(mesh.block[0] for mesh in live.mesh.meshes) >= max(
        mesh.block[0] for mesh in fresh.mesh.meshes
    )


def test_a_larger_bound_keeps_blocks_and_the_map_that_grows_into_marks_is_meshed(scene, live):
    small = lambda points: np.where(points[:, 0] < 0, scene.sdf(points), 1.0)  # noqa: E731
    live.refresh(small)
    half = live.area()
    live.marked.cover(Bound((-3.0, -3.0, -3.0), (6.0, 3.0, 3.0)))
    live.refresh()
    whole = _Live(scene, 60)
    whole.refresh()
    assert half < 0.8 * whole.area()
    assert live.area() == pytest.approx(whole.area(), rel=0.01)


def test_memory_is_that_of_the_surface(scene, live):
    live.refresh()
    nbytes = live.mesh.space.nbytes
    for _ in range(3):
        live.mark(60)
        live.refresh()
    assert live.mesh.space.nbytes == nbytes
    far = Bound((-30.0, -30.0, -30.0), (30.0, 30.0, 30.0))
    live.marked.cover(far)
    assert live.mesh.space.nbytes < 1.2 * nbytes + 10 * (70 / 0.48) ** 3
