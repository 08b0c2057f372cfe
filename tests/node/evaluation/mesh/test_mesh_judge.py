"""What counts as seen, for every mesh alike."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from hsslam_node.errors import UserError
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.evaluation.mesh.mesh_judge import given_views, load_mesh
from hsslam_node.export.opengl_axes import OPENGL_FROM_OPENCV
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_SYNTH = SynthOptions(width_px=64, height_px=48)
_OPTIONS = SourceOptions(frames=25, synth=_SYNTH)


def test_given_cameras_see_exactly_but_only_where_their_sensor_measured():
    """In the corridor, whose end is farther away than the sensor reaches."""
    truth = open_ground_truth("synth:corridor", _OPTIONS)
    assert truth is not None
    exact = given_views(truth, "synth:corridor", _OPTIONS)
    noisy = given_views(truth, "synth:corridor", replace(_OPTIONS, noise="kinect"))
    assert exact.depths_m.shape == (3, 48, 64)  # frames 0, 10 and 20
    np.testing.assert_array_equal(exact.T_world_cam, truth.T_world_cam[::10])
    measured = noisy.depths_m > 0
    np.testing.assert_array_equal(noisy.depths_m[measured], exact.depths_m[measured])
    far = exact.depths_m > 7.0  # its reach is 6 m; a pixel at an edge may show the nearer neighbour
    assert far.any()
    assert not measured[far].any()
    assert measured[(exact.depths_m > 0) & (exact.depths_m < 4.0)].mean() > 0.95


@pytest.mark.parametrize(
    "changed",
    [
        {"frames": 60, "hold_at": 15, "hold_frames": 40},
        {"frames": 60, "to_and_fro": 2, "stride": 50},
        {"frames": 60, "cover_at": 15, "cover_frames": 10},
    ],
)
def test_given_cameras_are_where_their_frames_were_seen(changed):
    options = replace(_OPTIONS, **changed)
    truth = open_ground_truth("synth:room", options)
    assert truth is not None
    found = given_views(truth, "synth:room", options)
    frames = list(open_source("synth:room", options).frames())[::10]
    np.testing.assert_array_equal(found.T_world_cam, truth.T_world_cam[::10])
    seen = [frame.depth_m() for frame in frames if isinstance(frame, Frame)]
    np.testing.assert_array_equal(found.depths_m, seen)


@pytest.mark.parametrize("length, every", [(3000, 10), (4000, 14)])
def test_a_long_run_has_as_many_given_cameras_as_fit_into_memory(length, every):
    options = SourceOptions(synth=SynthOptions(width_px=32, height_px=32, length=length))
    truth = open_ground_truth("synth:room", options)
    assert truth is not None
    found = given_views(truth, "synth:room", options)
    np.testing.assert_array_equal(found.T_world_cam, truth.T_world_cam[::every])
    assert found.depths_m.shape == (-(-length // every), 32, 32) and found.depths_m.all()


@pytest.mark.parametrize("suffix", [".ply", ".glb", ".GLB", ".gltf"])
def test_a_mesh_has_the_axes_that_it_had_before_it_was_written(tmp_path, suffix):
    box = trimesh.creation.box((1.0, 2.0, 3.0), transform=se3_exp(np.array([1, 2, 3, 0, 0, 0])))
    written = box.copy()
    if suffix != ".ply":
        written.apply_transform(OPENGL_FROM_OPENCV)
    kind = suffix[1:].lower()
    if kind == "gltf":
        for name, data in written.export(file_type=kind).items():
            (tmp_path / name).write_bytes(data)
        path = tmp_path / "model.gltf"
    else:
        path = tmp_path / f"mesh{suffix}"
        path.write_bytes(written.export(file_type=kind))
    np.testing.assert_allclose(load_mesh(path).bounds, box.bounds, atol=1e-6)


@pytest.mark.parametrize("name", ["mesh.ply", "mesh.usd", "points.pcd", "mesh.dae", "mesh"])
def test_what_is_no_mesh_is_named(tmp_path, name):
    path = tmp_path / name
    path.write_text("not a mesh")
    with pytest.raises(UserError, match=rf"^{path}: .*: expected a mesh .glb, .*\.stl$"):
        load_mesh(path)
    path.unlink()
    with pytest.raises(UserError, match=f"^{path}: no such file: expected a mesh .glb, "):
        load_mesh(path)


@pytest.mark.parametrize(
    ("vertex", "face", "problem"),
    [
        ((np.nan, 0, 0), (0, 1, 2), r"vertex 1 is at \(nan, 0, 0\) m"),
        ((1e30, 0, 0), (0, 1, 2), r"vertex 1 is at \(1e\+30, 0, 0\) m"),
        ((1, 0, 0), (0, 1, 7), "a face has vertex 7, of 4 vertices"),
        ((1, 0, 0), (0, 1, -1), "a face has vertex -1, of 4 vertices"),
    ],
)
def test_a_mesh_that_cannot_be_judged_is_refused(tmp_path, vertex, face, problem):
    lines = ["ply", "format ascii 1.0", "element vertex 4", "property double x"]
    lines += ["property double y", "property double z", "element face 1"]
    lines += ["property list uchar int vertex_indices", "end_header", "0 0 0"]
    lines += [" ".join(map(str, vertex)), "0 1 0", "nan 5 5"]  # the last one is in no face
    path = tmp_path / "mesh.ply"
    path.write_text("\n".join([*lines, "3 " + " ".join(map(str, face)), ""]))
    with pytest.raises(UserError, match=f"^{path}: {problem}: expected a mesh"):
        load_mesh(path)


def test_vertices_without_a_face_may_be_anything(tmp_path):
    path = tmp_path / "mesh.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 9e30 0 0\nf 1 2 3\n")
    assert len(load_mesh(path).faces) == 1
