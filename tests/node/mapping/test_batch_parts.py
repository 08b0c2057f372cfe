"""A batch in parts: the same step as in one, whoever computes it."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.mapping.batch_part import batch_parts
from hsslam_node.mapping.map_optimiser import MapOptimiser
from tests.small_room import SMALL, MappedRoom, mapped_room

KEYFRAMES = np.array([9, 8, 2, 5])


def _room(parts: int) -> MappedRoom:
    weights = replace(SMALL.weights, smoothness=1e-3)  # as large as the others
    mapper = replace(SMALL.mapper, parts=parts, smoothness_every=1)
    return mapped_room(replace(SMALL, mapper=mapper, weights=weights))


def _steps(parts: int, threads: int, steps: int = 1):
    """The change of the parameters, and the last report."""
    room = _room(parts)
    before = room.parameters.params.copy()
    optimiser = MapOptimiser(room.config, room.parameters, 501, threads)
    generator = np.random.default_rng(3)
    for _ in range(steps):
        report = optimiser.step(
            room.store, KEYFRAMES, np.array([100, 150, 50, 201]), room.store.poses_of(KEYFRAMES),
            generator, with_poses=True,
        )  # fmt: skip
    return room.parameters.params - before, report


def test_every_ray_is_in_one_part():
    for rays, parts in ((500, 1), (501, 2), (3, 4), (0, 2)):
        rows = [k for part in batch_parts(rays, parts) for k in range(rays)[part]]
        assert rows == list(range(rays))
        assert max(len(range(rays)[part]) for part in batch_parts(rays, parts)) <= -(-rays // parts)


def test_threads_change_no_bit():
    for parts in (2, 3):
        change, report = _steps(parts, threads=1, steps=3)
        again, other = _steps(parts, threads=3, steps=3)
        np.testing.assert_array_equal(change, again)
        assert report.loss == other.loss
        np.testing.assert_array_equal(report.pose_gradient, other.pose_gradient)
        np.testing.assert_array_equal(report.keyframe_loss, other.keyframe_loss)


@pytest.mark.parametrize("parts", [2, 3])
def test_parts_are_the_whole(parts):
    whole, report = _steps(1, threads=1)
    change, other = _steps(parts, threads=2)
    assert (report.rays, report.outside) == (other.rays, other.outside)
    assert other.loss == pytest.approx(report.loss, rel=1e-5)
    np.testing.assert_allclose(other.keyframe_loss, report.keyframe_loss, rtol=1e-4)
    np.testing.assert_allclose(
        other.pose_gradient, report.pose_gradient, atol=1e-4 * np.abs(report.pose_gradient).max()
    )
    np.testing.assert_array_equal(change != 0, whole != 0)
    # a first step of Adam is as long as its rate: where a gradient is rounding, its sign may differ
    moved = whole != 0
    close = np.abs(change - whole)[moved] < 1e-3 * np.abs(whole)[moved]
    assert moved.sum() > 1e5 and close.mean() > 0.98


def test_nothing_is_left_of_a_step():
    """Else the next one would step it again."""
    room = _room(3)
    optimiser = MapOptimiser(room.config, room.parameters, 500, 2)
    optimiser.step(
        room.store, KEYFRAMES, np.full(4, 100), room.store.poses_of(KEYFRAMES),
        np.random.default_rng(0),
    )  # fmt: skip
    for grad in optimiser._own_gradients():
        assert not grad.values.any() and not grad.touched.any()
