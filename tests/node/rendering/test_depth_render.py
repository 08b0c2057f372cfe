"""Depth images of meshes."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.rendering.chunked_mesh import CHUNK, chunked_mesh
from hsslam_node.rendering.depth_render import render_depth

CAMERA = Camera(32, 24, 25.0, 25.0, 15.5, 11.5)


def _cast(mesh: trimesh.Trimesh, T: np.ndarray) -> np.ndarray:
    """Depth of the nearest hit of each pixel's ray, solved triangle by triangle; 0: none."""
    v, u = np.mgrid[:24, :32].reshape(2, -1)
    rays = np.stack([(u - 15.5) / 25, (v - 11.5) / 25, np.ones(len(u))], 1) @ T[:3, :3].T
    nearest = np.full(len(u), np.inf)
    for a, b, c in np.asarray(mesh.triangles):
        system = np.stack(
            [rays, *np.broadcast_to([a - b, a - c], (len(u), 2, 3)).swapaxes(0, 1)], 2
        )
        z, beta, gamma = np.linalg.solve(system, np.tile((a - T[:3, 3])[:, None], (len(u), 1, 1)))[
            :, :, 0
        ].T
        hit = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1) & (z > 0.01)
        nearest[hit] = np.minimum(nearest[hit], z[hit])
    return np.where(np.isfinite(nearest), nearest, 0).reshape(24, 32)


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_depth_is_that_of_rays_cast_one_by_one(seed):
    """Triangles all around the camera, many of them reaching behind it."""
    rng = np.random.default_rng(seed)
    mesh = trimesh.Trimesh(rng.normal(0, 2, (18, 3)), np.arange(18).reshape(6, 3), process=False)
    T = se3_exp(rng.normal(size=6))
    depth, face = render_depth(chunked_mesh(mesh.vertices, mesh.faces), CAMERA, T)
    expected = _cast(mesh, T)
    agree = np.isclose(depth, expected, rtol=1e-4, atol=1e-5)
    assert agree.mean() > 0.995  # a ray through an edge may fall on either side
    np.testing.assert_array_equal(face >= 0, depth > 0)


def test_a_closed_surface_has_no_cracks():
    sphere = trimesh.creation.icosphere(4, 2.0)
    depth, _ = render_depth(chunked_mesh(sphere.vertices, sphere.faces), CAMERA, np.eye(4))
    assert depth.min() > 0.9  # planar depth of a far corner
    assert depth.max() == pytest.approx(2.0, abs=0.01)


def test_nothing_is_seen_of_nothing():
    depth, face = render_depth(
        chunked_mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), CAMERA, np.eye(4)
    )
    assert not depth.any()
    assert (face == -1).all()


@settings(max_examples=15)
@given(st.integers(0, 10_000))
def test_what_is_passed_over_would_not_have_been_seen(seed):
    """A thousand small triangles all around, and the same ones shuffled, whose chunks are everywhere."""
    rng = np.random.default_rng(seed)
    around = rng.normal(0, 2, (1024, 1, 3)) + rng.normal(0, 0.2, (1024, 3, 3))
    order = np.argsort(np.arctan2(around[:, 0, 1], around[:, 0, 0]), kind="stable")
    faces, T = np.arange(3072).reshape(1024, 3), se3_exp(rng.normal(size=6))
    near, far = (around[rows].reshape(-1, 3) for rows in (order, rng.permutation(1024)))
    assert len(chunked_mesh(near, faces).boxes) == 1024 // CHUNK
    depth, _ = render_depth(chunked_mesh(near, faces), CAMERA, T)
    np.testing.assert_array_equal(depth, render_depth(chunked_mesh(far, faces), CAMERA, T)[0])
    assert (depth > 0).any()
