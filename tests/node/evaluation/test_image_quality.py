"""Images that a map draws, and their distance to the true ones."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from skimage.metrics import structural_similarity

from hsslam_node.dense_map.map_renderer import MapRenderer
from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.image_quality import (
    field_drawer,
    image_qualities,
    psnr_db,
    ssim,
    view_drawer,
)
from hsslam_node.map.checkpoint import MapCheckpoint
from hsslam_node.reference.field import HybridField
from hsslam_node.reference.rendering import render_rays
from hsslam_node.rendering.ray_sampling import sample_rays
from tests.small_room import SMALL, mapped_room, room_frames, room_poses


@pytest.fixture(scope="module")
def checkpoint() -> MapCheckpoint:
    room = mapped_room()
    p, store = room.parameters, room.store
    return MapCheckpoint(p.layout, p.params.copy(), store.stamps_ns(), store.poses())


def _images() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    true = room_frames()[0].color / 255.0
    return np.clip(true + rng.normal(0, 0.05, true.shape), 0, 1), true


def test_psnr_of_a_known_error():
    true = _images()[1]
    assert psnr_db(true + 0.1, true) == pytest.approx(20.0)
    assert psnr_db(true - 0.01, true) == pytest.approx(40.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert psnr_db(true, true) == np.inf


def test_ssim_is_that_of_scikit_image_where_all_pixels_count():
    image, true = _images()
    grey = np.array([0.299, 0.587, 0.114])
    expected = structural_similarity(image @ grey, true @ grey, win_size=7, data_range=1.0)
    assert ssim(image, true, np.ones(true.shape[:2], bool)) == pytest.approx(expected, abs=1e-9)


def test_a_drawn_image_is_that_of_the_reference(checkpoint):
    frame, pose = room_frames()[6], room_poses()[6]
    depth = np.zeros_like(frame.depth_m())
    depth[10:110:9, 10:150:7] = frame.depth_m()[10:110:9, 10:150:7]
    renderer = MapRenderer(checkpoint.layout, checkpoint.params, SMALL.sampling)
    color, drawn_depth = renderer.render(depth, frame.camera, pose)
    v, u = np.nonzero(depth > 0)
    c = frame.camera
    rays = np.stack([(u - c.cx) / c.fx, (v - c.cy) / c.fy, np.ones(len(u))], axis=1)
    z = sample_rays(depth[v, u], SMALL.sampling, SMALL.field.truncation_m, 1.0, None)
    points = pose[:3, 3] + z[..., None] * (rays @ pose[:3, :3].T)[:, None]
    field = HybridField(checkpoint.layout, torch.from_numpy(checkpoint.params.copy()))
    with torch.no_grad():
        seen = field(torch.from_numpy(points.reshape(-1, 3).astype(np.float32)))
        rows = render_rays(
            seen.sdf.reshape(z.shape),
            seen.color.reshape(*z.shape, 3),
            torch.from_numpy(z),
            field.beta,
            seen.inside.reshape(z.shape),
        )
    np.testing.assert_allclose(color[v, u], rows.color.numpy().clip(0, 1), atol=2e-3)
    np.testing.assert_allclose(drawn_depth[v, u], rows.depth.numpy(), atol=2e-3)
    assert not color[depth == 0].any()


def test_a_trained_map_draws_what_it_has_not_seen(checkpoint):
    held_out = [(room_frames()[k], room_poses()[k]) for k in (6, 14)]
    blank = replace(checkpoint, params=np.zeros_like(checkpoint.params))
    room = mapped_room()
    with_images = map_snapshot(room.store, room.parameters, SMALL)
    found = image_qualities(
        {
            "field": field_drawer(checkpoint, SMALL),
            "blank": field_drawer(blank, SMALL),
            "view": view_drawer(SavedMap(Path("m"), with_images, "cpu")),
        },
        held_out,
    )
    assert found["field"].images == 2
    assert found["field"].psnr_db > found["blank"].psnr_db + 3
    assert found["view"].psnr_db > found["blank"].psnr_db + 3
    assert found["view"].ssim > found["field"].ssim + 0.01
    assert found["field"].pixels_ratio == found["view"].pixels_ratio > 0.9


def test_no_image_no_figure(checkpoint):
    found = image_qualities({"field": field_drawer(checkpoint, SMALL)}, [])["field"]
    assert found.images == 0 and np.isnan(found.psnr_db)
