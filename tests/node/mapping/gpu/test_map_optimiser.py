"""The GPU's optimiser does what the CPU's does, with the same random numbers: on a GPU where there is
one, else interpreted.

Tolerances: both compute in float32 but add in different orders, so losses and gradients agree to some
1e-6 of their size. Adam's eps is 1e-15: an entry whose gradient is all rounding, the sum of what nearly
cancels, still moves by a whole rate, either way. Such entries are rare; of them only their number and
that they stay within two rates a step can be asked. From the second step on the losses are those of
maps that differ by these entries: 1e-3, where the first step is held to 1e-5.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from hsslam_node.config import BoundConfig, SlamConfig
from hsslam_node.device.device import CPU
from hsslam_node.mapping.map_optimiser import StepReport
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.mapping.open_map_optimiser import Optimiser, open_map_optimiser
from hsslam_node.rendering.ray_sampling import SamplingPattern
from tests.node.gpu_kernels.interpreter import GPU, import_gpu_kernels
from tests.small_room import SMALL, TINY_FIELD, MappedRoom, empty_room

import_gpu_kernels()

KEYFRAMES = np.array([9, 0, 4])
TINY: SlamConfig = replace(
    SMALL,
    field=TINY_FIELD,
    bound=BoundConfig(margin=1.0, least_m=2.0, most_m=4.0),
    mapper=replace(SMALL.mapper, smoothness_vertices=2, smoothness_every=2, least_color_weight=0.0),
)
WITH_PATCHES: SlamConfig = replace(
    TINY,
    sampling=SamplingPattern(free_samples=0, surface_samples=1, free_reach=1.0, surface_reach=1.0),
    mapper=replace(TINY.mapper, patch_repeats=1),
)


@dataclass(frozen=True)
class Pair:
    """The same map twice, each with an optimiser of its own kind."""

    rooms: tuple[MappedRoom, MappedRoom]
    optimisers: tuple[Optimiser, Optimiser]

    def step(self, counts: list[int], seed: int, **options: bool) -> tuple[StepReport, StepReport]:
        """One step of the CPU's and of the GPU's optimiser."""
        reports = []
        for room, optimiser in zip(self.rooms, self.optimisers, strict=True):
            poses = room.store.poses()[KEYFRAMES]
            generator = np.random.default_rng(seed)
            reports.append(
                optimiser.step(room.store, KEYFRAMES, np.array(counts), poses, generator, **options)
            )
        return reports[0], reports[1]


def _pair(config: SlamConfig, rays: int) -> Pair:
    rooms = empty_room(config), empty_room(config)
    cpu, gpu = (
        open_map_optimiser(config, room.parameters, rays, device)
        for room, device in zip(rooms, (CPU, GPU), strict=True)
    )
    return Pair(rooms, (cpu, gpu))


def _expect_same(cpu: StepReport, gpu: StepReport, relative: float = 1e-5) -> None:
    assert (gpu.rays, gpu.outside) == (cpu.rays, cpu.outside)
    assert gpu.loss == pytest.approx(cpu.loss, rel=relative)
    np.testing.assert_allclose(gpu.keyframe_loss, cpu.keyframe_loss, rtol=relative)
    scale = np.abs(cpu.pose_gradient).max()
    np.testing.assert_allclose(gpu.pose_gradient, cpu.pose_gradient, atol=relative * scale)


def _expect_same_parameters(pair: Pair, steps: int) -> None:
    cpu, gpu = (room.parameters for room in pair.rooms)
    assert gpu.step == cpu.step == steps
    np.testing.assert_array_equal(gpu.stepped_at, cpu.stepped_at)
    for name in ("first_moment", "second_moment"):
        expected, found = getattr(cpu, name), getattr(gpu, name)
        assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected), name
    error = np.abs(gpu.params - cpu.params)
    m = TINY.mapper
    assert error.max() <= 2 * steps * max(m.plane_rate, m.hash_rate, m.decoder_rate)
    assert (error > 1e-4).mean() < 1e-3
    initial = empty_room(TINY).parameters.params
    assert np.linalg.norm(gpu.params - cpu.params) < 0.01 * np.linalg.norm(cpu.params - initial)


def test_four_steps_agree():
    """Fewer rays than the work space holds, in turn with more; smoothness in every second step."""
    pair = _pair(TINY, 10)
    for k in range(4):
        cpu, gpu = pair.step([4, 3, 3] if k % 2 else [3, 2, 2], k, with_poses=k == 3)
        _expect_same(cpu, gpu, 1e-5 if k == 0 else 1e-3)
        assert cpu.pose_gradient.any() == (k == 3)
        if k == 0:
            pair.optimisers[1].push()
            _expect_same_parameters(pair, 1)
    pair.optimisers[1].push()
    _expect_same_parameters(pair, 4)
    pair.rooms[1].parameters.publish()
    np.testing.assert_array_equal(
        pair.rooms[1].parameters.published()[1], pair.rooms[1].parameters.params
    )


@pytest.fixture
def late(monkeypatch) -> None:
    """Let the reports of small steps come late, as those of large steps do."""
    monkeypatch.setattr("hsslam_node.mapping.gpu.map_optimiser._LATE_FROM", 0)


def test_a_report_is_of_its_own_step_also_after_the_next(late):
    pair = _pair(TINY, 10)
    first = pair.step([3, 2, 2], 0, with_poses=True)
    second = pair.step([4, 3, 3], 1)
    _expect_same(*first)
    _expect_same(*second, 1e-3)


def test_a_mapper_moves_poses_by_reports_that_come_late(late):
    mapper_config = replace(TINY.mapper, rays=12, window_keyframes=4, pose_rate=1e-3)
    config = replace(TINY, mapper=mapper_config)
    refined = []
    for device in (CPU, GPU):
        room = empty_room(config)
        mapper = Mapper(config, room.parameters, 0, device)
        assert mapper._optimiser.reports_late == (device is GPU)
        for _ in range(3):
            mapper.iterate(room.store)
        found = mapper.take_poses(room.store)
        assert found is not None
        shifts = found.T_world_cam[:, :3, 3] - room.store.poses()[found.keyframes][:, :3, 3]
        refined.append((found.keyframes.tolist(), shifts))
    assert refined[0][0] == refined[1][0] and np.abs(refined[0][1]).max() > 1e-3
    np.testing.assert_allclose(refined[1][1], refined[0][1], atol=1e-4)


def test_patches_agree_and_a_probe_steps_nothing():
    pair = _pair(WITH_PATCHES, 260)
    before = pair.rooms[1].parameters.params.copy()
    _expect_same(*pair.step([16, 16, 16], 5, update=False))
    pair.optimisers[1].push()
    np.testing.assert_array_equal(pair.rooms[1].parameters.params, before)
    _expect_same(*pair.step([110, 110, 40], 6))
    pair.optimisers[1].push()
    _expect_same_parameters(pair, 1)


def test_without_rays_nothing_is_stepped():
    pair = _pair(TINY, 10)
    for report in pair.step([0, 0, 0], 0):
        assert report.rays == 0 and report.loss == 0.0
    assert pair.rooms[1].parameters.step == 0
