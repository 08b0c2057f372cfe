"""The GPU's term of an alignment is the CPU's, also after the map has moved on."""

from dataclasses import replace

import numpy as np

from hsslam_node.config import BoundConfig, FieldConfig
from hsslam_node.device.device import CPU
from hsslam_node.kernels.tracking.depth_points import transform_points
from hsslam_node.tracking.alignment.frame_terms import open_sdf_term
from hsslam_node.tracking.alignment.sdf_term import SdfEvidence
from hsslam_node.tracking.map_view import MapView, MapViews
from tests.node.gpu_kernels.interpreter import GPU, import_gpu_kernels
from tests.small_room import SMALL, displaced, empty_room

import_gpu_kernels()

CONFIG = replace(
    SMALL,
    field=FieldConfig(plane_channels=16, hash_levels=4, hash_table_log2=10),
    bound=BoundConfig(margin=1.0, least_m=1.3, most_m=2.2),  # some points lie outside
)


def test_both_terms_agree_for_each_version_of_the_map():
    room = empty_room(CONFIG)
    frame = room.store.frame(0)
    v, u = np.mgrid[6:114:12, 6:154:12].reshape(2, -1)
    z, c = frame.depth_m()[v, u], frame.camera
    points = np.stack([(u - c.cx) * z / c.fx, (v - c.cy) * z / c.fy, z], axis=1).astype(np.float32)
    points = np.ascontiguousarray(points[z > 0])
    views = [MapViews(room.parameters, device) for device in (CPU, GPU)]
    assert views[0].newest() is None and views[1].newest() is None

    T = displaced(np.eye(4), 0.05, 3.0)
    for version in (1, 2):
        _disturb(room.parameters, seed=version)
        room.parameters.publish()
        cpu, gpu = (view.newest() for view in views)
        assert cpu is not None and gpu is not None and cpu.version == gpu.version == version
        H, b, evidence = _linearised(cpu, points, T)
        gpu_H, gpu_b, gpu_evidence = _linearised(gpu, points, T)
        assert 0 < evidence.inliers < evidence.seen < len(points)
        assert gpu_evidence[:2] == evidence[:2]
        np.testing.assert_allclose(gpu_evidence.squares_m2, evidence.squares_m2, rtol=1e-4)
        np.testing.assert_allclose(gpu_H, H, atol=1e-4 * np.abs(H).max())
        np.testing.assert_allclose(gpu_b, b, atol=1e-4 * np.abs(b).max())


def _disturb(parameters, seed: int) -> None:
    """What a step of somebody else does, to every third chunk."""
    rows = parameters.params.reshape(-1, 16)[::3]
    rows += np.random.default_rng(seed).normal(0, 0.3, rows.shape).astype(np.float32)
    chunks = np.arange(0, len(parameters.stepped_at), 3)
    parameters.mark_stepped(chunks, parameters.count_step())


def _linearised(
    view: MapView, points: np.ndarray, T: np.ndarray
) -> tuple[np.ndarray, np.ndarray, SdfEvidence]:
    world = np.empty_like(points)
    transform_points(T, points, world)
    H, b = np.zeros((8, 8)), np.zeros(8)
    term = open_sdf_term(view, (points[::4].copy(), points), CONFIG.tracker)
    evidence = term.add(T, world, True, H, b)
    return np.triu(H), b, evidence
