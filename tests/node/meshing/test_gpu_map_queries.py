"""The GPU answers meshing as the CPU does."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from hsslam_node.config import FieldConfig
from hsslam_node.device.device import CPU
from hsslam_node.meshing.map_queries import open_map_queries
from tests.node.gpu_kernels.interpreter import GPU, import_gpu_kernels
from tests.small_room import SMALL, empty_room

import_gpu_kernels()

CONFIG = replace(SMALL, field=FieldConfig(plane_channels=16, hash_levels=4, hash_table_log2=10))


def test_distance_and_colour_agree():
    layout = empty_room(CONFIG).parameters.layout
    rng = np.random.default_rng(0)
    params = rng.normal(0, 0.2, layout.parameter_count).astype(np.float32)
    low, high = np.array(layout.bound.low), np.array(layout.bound.high)
    points = rng.uniform(low - 0.2, high + 0.2, (90, 3)).astype(np.float32)
    cpu, gpu = (open_map_queries(layout, params, device) for device in (CPU, GPU))
    expected = cpu.sdf(points)
    assert (expected == 1).any() and (np.abs(expected) < 0.9).any()
    np.testing.assert_allclose(gpu.sdf(points), expected, atol=1e-5)
    points = points[expected < 1]  # colours outside mean nothing
    for part in (points[:20], points):  # the second needs more work space
        np.testing.assert_allclose(gpu.color(part), cpu.color(part), atol=1e-5)
    nothing = np.empty((0, 3), np.float32)
    assert gpu.sdf(nothing).shape == (0,) and gpu.color(nothing).shape == (0, 3)


def test_threads_that_ask_one_map_get_the_colours_of_their_own_points():
    layout = empty_room(CONFIG).parameters.layout
    params = np.random.default_rng(0).normal(0, 0.2, layout.parameter_count).astype(np.float32)
    low, high = np.array(layout.bound.low), np.array(layout.bound.high)
    points = [(low + k / 5 * (high - low))[None].astype(np.float32) for k in (1, 2, 3, 4)]
    queries = open_map_queries(layout, params, GPU)
    expected = [queries.color(part) for part in points]
    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(queries.color, points))
    np.testing.assert_array_equal(found, expected)
