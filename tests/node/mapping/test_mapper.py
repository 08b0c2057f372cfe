"""Mapping lowers the loss, repeats to the bit, and goes on after a restart as if nothing was."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.field.sdf_query import query_sdf
from hsslam_node.mapping.map_optimiser import StepReport
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.mapping.ray_batch import RayDraw, ray_batch
from tests.small_room import SMALL, MappedRoom, displaced, empty_room, mapped_room


def _surface_sdf(room: MappedRoom, offset_m: float) -> np.ndarray:
    """SDF, in metres, of points this far in front of the surface that keyframe 5 sees."""
    frame, T = room.store.frame(5), room.store.pose(5)
    z = frame.depth_m()[20:100:3, 20:140:3].astype(np.float64)
    v, u = np.mgrid[20:100:3, 20:140:3]
    camera = frame.camera
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(z)], -1)
    points = (rays * (z - offset_m)[..., None])[z > 0] @ T[:3, :3].T + T[:3, 3]
    n = len(points)
    sdf, inside = np.empty(n, np.float32), np.empty(n, np.uint8)
    query_sdf(
        room.parameters.params, kernel_layout(room.parameters.layout), points.astype(np.float32),
        sdf, inside, np.empty((n, 3), np.float32), False,
    )  # fmt: skip
    assert inside.all()
    return sdf * SMALL.field.truncation_m


def test_the_loss_falls():
    room = empty_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    reports = [mapper.initialise(room.store) for _ in range(60)]
    losses = [r.loss for r in reports]
    assert np.isfinite(losses).all() and np.mean(losses[-5:]) < 0.1 * np.mean(losses[:5])
    assert all(r.rays == SMALL.mapper.rays for r in reports)
    assert room.parameters.step == 60


def test_the_trained_map_knows_the_surface():
    room = mapped_room()
    assert np.median(np.abs(_surface_sdf(room, 0.0))) < 0.006
    before, behind = _surface_sdf(room, 0.03), _surface_sdf(room, -0.03)
    assert (before > 0).mean() > 0.95 and (behind < 0).mean() > 0.9
    least_m = SMALL.weights.free_sdf * SMALL.field.truncation_m
    assert (_surface_sdf(room, 0.3) > least_m).mean() > 0.95  # free space


@pytest.mark.parametrize("factor", [1.0, 0.1])
def test_the_steps_of_the_last_iterations_get_smaller(factor):
    changes = []
    for done in (0.0, 1.0):
        room = mapped_room()
        config = replace(SMALL, mapper=replace(SMALL.mapper, last_rate_factor=factor))
        mapper, before = Mapper(config, room.parameters, 0), room.parameters.params.copy()
        mapper.refine_sparse(room.store, done)
        changes.append(np.linalg.norm(room.parameters.params - before))
    assert changes[1] == pytest.approx(factor * changes[0], rel=0.01)


def test_the_same_seed_gives_the_same_parameters_to_the_bit():
    rooms = []
    for seed in (0, 0, 1):
        room = empty_room()
        mapper = Mapper(SMALL, room.parameters, seed)
        for _ in range(4):
            mapper.iterate(room.store)
        rooms.append(room)
    first, second, third = (room.parameters for room in rooms)
    np.testing.assert_array_equal(first.params, second.params)
    np.testing.assert_array_equal(first.second_moment, second.second_moment)
    assert (first.params != third.params).any()


def test_a_gradient_that_a_dead_process_has_left_is_cleared():
    sound, hurt = empty_room(), empty_room()
    for room in (sound, hurt):
        Mapper(SMALL, room.parameters, 0).iterate(room.store)
    values, touched = hurt.parameters.gradient_arrays()
    assert not values.any() and not touched.any()
    stepping = hurt.parameters.stepping(values, touched)
    stepping.__enter__()  # and it dies in the middle of the step
    values[::7], touched[::3] = 5.0, 9
    for room in (sound, hurt):
        Mapper(SMALL, room.parameters, 1).iterate(room.store)
    np.testing.assert_array_equal(sound.parameters.params, hurt.parameters.params)
    assert not values.any() and not touched.any()


def test_all_who_step_a_map_share_one_gradient():
    room = empty_room()
    alone, together = Mapper(SMALL, empty_room().parameters, 0), Mapper(SMALL, room.parameters, 0)
    other = Mapper(SMALL, room.parameters, 0)
    assert alone.iterate(room.store).loss == together.iterate(room.store).loss
    assert np.isfinite(other.iterate(room.store).loss)
    values, _ = room.parameters.gradient_arrays()
    assert np.shares_memory(values, room.parameters.gradient_arrays()[0]) and not values.any()


def test_a_restarted_mapper_goes_on_with_the_same_numbers():
    through, restarted = empty_room(), empty_room()
    mapper = Mapper(SMALL, through.parameters, 0)
    for _ in range(4):
        mapper.iterate(through.store)
    for _ in range(2):
        mapper = Mapper(SMALL, restarted.parameters, 0)
        for _ in range(2):
            mapper.iterate(restarted.store)
    np.testing.assert_array_equal(through.parameters.params, restarted.parameters.params)


def test_published_parameters_follow_the_steps():
    room = empty_room()
    mapper = Mapper(SMALL, room.parameters, 0)
    for _ in range(3):
        mapper.iterate(room.store)
        room.parameters.publish()
        _, published = room.parameters.published()
        np.testing.assert_array_equal(published, room.parameters.params)


def test_any_number_of_keyframes_makes_a_window():
    for window in (1, 2, 3, 20):
        config = replace(SMALL, mapper=replace(SMALL.mapper, window_keyframes=window))
        for count in (1, 2, 3, 10):
            room = empty_room(config)
            room.store._header[0] = count  # as it was when there were so many
            report = Mapper(config, room.parameters, 0).iterate(room.store)
            n = min(window, count)
            assert len(report.keyframe_loss) == n
            assert SMALL.mapper.rays - n - 1 <= report.rays <= SMALL.mapper.rays
            assert (report.keyframe_loss > 0).all()


def _windows_with(keyframe: int, moved_share: float, *, is_restarted: bool = False) -> int:
    """In how many of eight windows of four the keyframe is, whose pose was corrected just now.

    `is_restarted`: another mapper makes the eight.
    """
    config = replace(
        SMALL, mapper=replace(SMALL.mapper, window_keyframes=4, moved_share=moved_share)
    )
    room = empty_room(config)
    mapper, windows = Mapper(config, room.parameters, 0), []

    def step(store, keyframes, counts, poses, generator, **_) -> StepReport:
        windows.append(keyframes.tolist())
        room.parameters.count_step()
        return StepReport(0, 0, 0.0, np.zeros(len(keyframes)), np.zeros((len(keyframes), 6)))

    mapper._optimiser.step = step
    mapper.iterate(room.store)  # notes where all keyframes are
    room.store.correct_poses(
        np.array([keyframe]), displaced(room.store.pose(keyframe), 0.02, 0.0)[None]
    )
    windows.clear()
    if is_restarted:
        mapper = Mapper(config, room.parameters, 0)
        mapper._optimiser.step = step
    for _ in range(8):
        mapper.iterate(room.store)
    return sum(keyframe in window for window in windows)


def test_keyframes_that_moved_come_first_where_that_is_wanted():
    assert _windows_with(3, moved_share=0.5) == 8
    assert _windows_with(3, moved_share=0.0) <= 5  # two of eight older ones in each window


def test_a_restarted_mapper_knows_which_keyframes_have_moved():
    assert _windows_with(3, moved_share=0.5, is_restarted=True) == 8


def test_rays_are_drawn_where_there_is_depth():
    store = empty_room().store
    batch = ray_batch(300)
    draw = RayDraw(replace(SMALL.mapper, max_depth_m=8.0))
    n = draw.fill(batch, store, np.array([3, 7]), np.array([100, 200]), np.random.default_rng(0))
    assert n == 300 and np.bincount(batch.slot).tolist() == [100, 200]
    camera = store.camera
    u = np.rint(batch.direction[:, 0] * camera.fx + camera.cx).astype(int)
    v = np.rint(batch.direction[:, 1] * camera.fy + camera.cy).astype(int)
    for slot, k in enumerate((3, 7)):
        frame, mine = store.frame(k), batch.slot == slot
        np.testing.assert_allclose(batch.depth[mine], frame.depth_m()[v[mine], u[mine]], rtol=1e-6)
        color = frame.color[v[mine], u[mine]] / 255
        np.testing.assert_allclose(batch.color[mine], color, atol=1e-6)
