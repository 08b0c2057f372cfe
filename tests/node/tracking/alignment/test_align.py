"""Alignment takes a displaced start to the true pose."""

from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.geometry.se3 import se3_exp, transformed
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.kernels.tracking.depth_points import sample_points
from hsslam_node.tracking.aligned.acceptance import quality
from hsslam_node.tracking.alignment.align import Alignment, align
from hsslam_node.tracking.keyframes.reference_keyframe import grey_pyramid, reference_keyframe
from hsslam_node.tracking.map_view import MapView
from tests.small_room import MappedRoom, displaced, mapped_room, pose_error, room_frames, room_poses

FRAME, KEYFRAME = 9, 1  # keyframe 1 is frame 4


@pytest.fixture(scope="module")
def room() -> MappedRoom:
    return mapped_room()


def _points(frame) -> np.ndarray:
    rows, columns = 30, 40
    jitter = np.random.default_rng(0).random((rows * columns, 2))
    points = np.empty((rows * columns, 3), np.float32)
    camera = frame.camera
    K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
    n = sample_points(frame.depth_m(), K, jitter, columns, rows, 8, np.float32(6.0), 0, 0.0, points)
    return points[:n]


def _aligned(
    room: MappedRoom, start: np.ndarray, *, with_map: bool, with_keyframe: bool, world=None, **terms
) -> Alignment:
    config = replace(room.config.tracker, **terms)
    key, frame = room.store.frame(KEYFRAME), room_frames()[FRAME]
    version, params = room.parameters.published()
    layout = kernel_layout(room.parameters.layout)
    view = MapView(version, layout, params, room.config.field.truncation_m) if with_map else None
    reference = (
        reference_keyframe(KEYFRAME, key, grey_pyramid(key), config) if with_keyframe else None
    )
    T_world_ref = room.store.pose(KEYFRAME) if world is None else world @ room.store.pose(KEYFRAME)
    levels = grey_pyramid(frame)
    return align(_points(frame), levels, start, view, reference, T_world_ref, config)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("with_map", [False, True], ids=["keyframe", "keyframe and map"])
def test_two_centimetres_and_a_degree_are_recovered(room, with_map, seed):
    truth = room_poses()[FRAME]
    start = displaced(truth, 0.02, 1.0, seed)
    result = _aligned(room, start, with_map=with_map, with_keyframe=True)
    distance_m, angle_deg = pose_error(result.T_world_cam, truth)
    assert distance_m < 0.003 and angle_deg < 0.15
    assert result.surface_inlier_ratio > 0.8 and result.photometric_inlier_ratio > 0.5
    assert np.isfinite(result.sdf_inlier_ratio) == with_map
    if with_map:
        assert result.sdf_inlier_ratio > 0.8 and result.sdf_rms_m < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_the_map_alone_recovers_it_too(room, seed):
    truth = room_poses()[FRAME]
    start = displaced(truth, 0.02, 1.0, seed)
    result = _aligned(room, start, with_map=True, with_keyframe=False, iterations=8)
    distance_m, angle_deg = pose_error(result.T_world_cam, truth)
    assert distance_m < 0.01 and angle_deg < 0.4  # from 2 cm and 1 degree
    assert np.isnan(result.surface_inlier_ratio) and np.isnan(result.photometric_inlier_ratio)


def test_without_its_weight_the_map_judges_and_does_not_move(room):
    start = displaced(room_poses()[FRAME], 0.02, 1.0)
    alone, judged, both = (
        _aligned(room, start, with_map=with_map, with_keyframe=True, sdf_weight=weight)
        for with_map, weight in ((False, 1.0), (True, 0.0), (True, 1.0))
    )
    assert np.array_equal(judged.T_world_cam, alone.T_world_cam)
    assert judged.sdf_inlier_ratio > 0.8 and judged.sdf_rms_m < 0.01
    assert not np.array_equal(both.T_world_cam, alone.T_world_cam)


def test_without_a_keyframe_the_weight_of_the_map_does_not_count(room):
    start = displaced(room_poses()[FRAME], 0.02, 1.0)
    full, none = (
        _aligned(room, start, with_map=True, with_keyframe=False, sdf_weight=weight)
        for weight in (1.0, 0.0)
    )
    assert np.array_equal(full.T_world_cam, none.T_world_cam)


def test_the_map_is_asked_for_few_of_many_points_and_the_keyframe_for_all(room):
    truth = room_poses()[FRAME]
    start = displaced(truth, 0.02, 1.0)
    few, many = (
        _aligned(room, start, with_map=True, with_keyframe=True, points=points)
        for points in (300, 2000)
    )
    assert few.surface_coverage == pytest.approx(many.surface_coverage, abs=0.02)
    assert few.sdf_inlier_ratio > 0.8
    distance_m, angle_deg = pose_error(few.T_world_cam, truth)
    assert distance_m < 0.005 and angle_deg < 0.2
    away = np.eye(4)
    away[:3, 3] = 100.0  # all points lie outside the bound
    terms = {"iterations": 1, "with_map": True, "with_keyframe": False}
    few, many = (_aligned(room, away, points=points, **terms).outside for points in (300, 2000))
    assert 300 < few < 350 and few == -(-many // 3)


def test_the_photometric_term_can_be_left_out(room):
    truth = room_poses()[FRAME]
    start = displaced(truth, 0.02, 1.0)
    terms = {"iterations": 8, "photometric_pixels": 0}
    result = _aligned(room, start, with_map=False, with_keyframe=True, **terms)
    assert pose_error(result.T_world_cam, truth)[0] < 0.01
    assert np.isnan(result.photometric_inlier_ratio)


def test_the_world_has_no_preferred_place(room):
    """Alignment to a keyframe turns and moves with the world."""
    truth = room_poses()[FRAME]
    world = se3_exp(np.array([4.0, -7.0, 2.0, 0.8, -1.1, 0.5]))
    start = displaced(truth, 0.02, 1.0)
    here = _aligned(room, start, with_map=False, with_keyframe=True)
    there = _aligned(room, world @ start, with_map=False, with_keyframe=True, world=world)
    distance_m, angle_deg = pose_error(there.T_world_cam, world @ here.T_world_cam)
    assert distance_m < 2e-4 and angle_deg < 0.01


@pytest.mark.parametrize(("bias", "gain"), [(25, 1.0), (0, 0.6), (-20, 1.3)])
def test_a_change_of_exposure_does_not_move_the_camera(room, bias, gain):
    truth = room_poses()[FRAME]
    frame = room_frames()[FRAME]
    color = np.clip(frame.color * gain + bias, 0, 255).astype(np.uint8)
    brighter = replace(frame, color=color)
    key = room.store.frame(KEYFRAME)
    reference = reference_keyframe(KEYFRAME, key, grey_pyramid(key), room.config.tracker)
    result = align(
        _points(frame), grey_pyramid(brighter), displaced(truth, 0.02, 1.0), None, reference,
        room.store.pose(KEYFRAME), room.config.tracker,
    )  # fmt: skip
    distance_m, angle_deg = pose_error(result.T_world_cam, truth)
    assert distance_m < 0.003 and angle_deg < 0.15
    assert abs(result.exposure.gain - gain) < 0.1 and abs(result.exposure.bias - bias) < 10


def test_points_outside_the_bound_are_counted(room):
    away = room_poses()[FRAME].copy()
    away[:3, 3] += 100.0
    result = _aligned(room, away, with_map=True, with_keyframe=False)
    assert result.outside > 500 and np.isnan(result.sdf_inlier_ratio)
    np.testing.assert_allclose(result.T_world_cam, away, atol=1e-9)


@pytest.mark.parametrize(("share", "is_judged"), [(0.02, False), (0.2, True)])
def test_the_map_does_not_judge_a_frame_of_which_few_points_are_in_its_bound(
    room, share, is_judged
):
    truth, aside = room_poses()[FRAME], np.eye(4)
    z = transformed(truth, _points(room_frames()[FRAME]))[:, 2]
    aside[2, 3] = room.parameters.layout.bound.high[2] - np.quantile(z, share)
    result = _aligned(
        room, aside @ truth, world=aside, with_map=True, with_keyframe=True, sdf_weight=0.0
    )
    assert 0 < len(z) - result.outside < 1.2 * share * len(z)
    assert np.isfinite(result.sdf_inlier_ratio) == np.isfinite(result.sdf_rms_m) == is_judged
    assert result.surface_inlier_ratio > 0.8
    assert (quality(result) == result.surface_inlier_ratio) != is_judged
