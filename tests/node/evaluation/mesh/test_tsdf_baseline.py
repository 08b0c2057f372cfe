"""The TSDF that maps are compared with."""

import builtins
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_judge import given_views
from hsslam_node.evaluation.mesh.mesh_metrics import compare_meshes
from hsslam_node.evaluation.mesh.tsdf_baseline import TSDF_SETTINGS, TsdfOptions, fuse_tsdfs
from tests.small_room import OPTIONS, room_frames


def test_exact_depth_at_true_poses_gives_the_true_surface():
    pytest.importorskip("open3d", exc_type=ImportError)
    truth = open_ground_truth("synth:room", OPTIONS)
    assert truth is not None
    posed = [*zip(room_frames(), truth.T_world_cam, strict=True)]
    blind = replace(posed[0][0], depth_raw=np.zeros_like(posed[0][0].depth_raw))
    far = replace(posed[0][0], depth_raw=np.full_like(posed[0][0].depth_raw, 65_535))
    posed[1:1] = [(blind, posed[0][1]), (far, posed[0][1])]
    (mesh,) = fuse_tsdfs(posed, [TsdfOptions(voxel_m=0.03)]).values()
    surface = truth.mesh()
    assert surface is not None
    found = compare_meshes(mesh, surface, given_views(truth, "synth:room", OPTIONS), 20_000)
    assert found.accuracy_median_m < 0.01
    assert found.completion_ratio_5cm > 0.9
    assert np.ptp(np.asarray(mesh.visual.vertex_colors)[:, :3]) > 100  # type: ignore[union-attr]


def test_no_frame_no_mesh():
    pytest.importorskip("open3d", exc_type=ImportError)
    found = fuse_tsdfs([])
    assert list(found) == [options.name for options in TSDF_SETTINGS]
    assert all(
        isinstance(mesh, trimesh.Trimesh) and len(mesh.vertices) == 0 for mesh in found.values()
    )


def test_without_open3d_one_line_says_what_to_install(monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name == "open3d":
            raise ImportError("libusb-1.0.so.0: cannot open shared object file")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match="libusb"):
        fuse_tsdfs([])


def test_options_are_checked():
    with pytest.raises(UserError, match="tsdf"):
        TsdfOptions(voxel_m=0.0)
