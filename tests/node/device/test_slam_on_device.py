"""The whole algorithm on the GPU's code path: tracking, mapping, bundle adjustment, publication."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import BoundConfig
from hsslam_node.device.device import CPU
from hsslam_node.slam import Slam
from tests.node.gpu_kernels.interpreter import GPU, import_gpu_kernels
from tests.small_room import SMALL, TINY_FIELD, room_frames

import_gpu_kernels()

CONFIG = replace(
    SMALL,
    field=TINY_FIELD,
    bound=BoundConfig(margin=1.0, least_m=2.0, most_m=4.0),
    keyframes=replace(SMALL.keyframes, every_frames=1),
    tracker=replace(SMALL.tracker, points=120, iterations=1, min_inlier_ratio=0.0),
    mapper=replace(
        SMALL.mapper,
        rays=8,
        first_iterations=1,
        iterations=1,
        last_iterations=1,
        least_color_weight=0.0,  # the GPU asks colour of all samples
    ),
    ba=replace(
        SMALL.ba,
        every_keyframes=1,
        iterations=1,
        rays=8,
        probe_keyframes=2,
        probe_rays=3,
        loss_threshold=1e-6,
    ),
)


def test_two_frames_give_the_poses_and_the_map_of_the_cpu():
    """A map after so few steps: rounding that Adam amplifies moves a pose by less than 0.1 mm."""
    runs = [Slam(CONFIG, device=device) for device in (CPU, GPU)]
    for frame in room_frames()[:2]:
        cpu, gpu = (slam.process(frame) for slam in runs)
        assert gpu.status == cpu.status and gpu.map_version == cpu.map_version
        np.testing.assert_allclose(gpu.T_world_cam, cpu.T_world_cam, atol=1e-4)
    for slam in runs:
        slam.finish()  # after bundle adjustment has stepped: the mapper's copy has to follow
    cpu, gpu = (slam.parameters for slam in runs)
    assert cpu and gpu and gpu.step == cpu.step == 5 and gpu.version == cpu.version == 3
    np.testing.assert_array_equal(gpu.stepped_at, cpu.stepped_at)
    assert np.linalg.norm(gpu.params - cpu.params) < 0.01 * np.linalg.norm(cpu.params)
    poses = [slam.store.poses() for slam in runs if slam.store]
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-4)
