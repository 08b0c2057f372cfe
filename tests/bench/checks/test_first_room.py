"""The mesh of a run is scored where the first frames looked, whatever the world of the run."""

import numpy as np
import pytest
import trimesh

from hsslam_bench.checks import map as map_checks
from hsslam_bench.checks.map import FirstRoom, first_room, score_first_room
from hsslam_node.geometry.se3 import inverse, se3_exp
from hsslam_node.geometry.trajectory import Trajectory, write_tum


@pytest.fixture(scope="module")
def room() -> FirstRoom:
    return first_room("synth:room", 20)


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(map_checks, "_SAMPLES", 10_000)


def _run_with(folder, room: FirstRoom, mesh: trimesh.Trimesh):
    """A run folder whose world is turned and moved against that of the truth."""
    T = se3_exp(np.array([0.3, -0.2, 1.0, 0.1, 0.4, -0.2]))
    moved = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    moved.apply_transform(T).export(folder / "mesh.ply")
    poses = T @ room.truth.T_world_cam
    write_tum(folder / "trajectory.txt", Trajectory(room.truth.stamps_ns, poses))
    return folder


def test_the_true_mesh_is_right_and_complete(room, tmp_path):
    score = score_first_room(room, _run_with(tmp_path, room, room.mesh))
    assert score.accuracy_mean_m < 1e-4 and score.completion_ratio_5cm > 0.999


def test_what_the_first_frames_did_not_see_does_not_count(room, tmp_path):
    """Triangles that the first frames saw alone are as good as all; without them little is complete."""
    seen = room.views.observed(room.mesh.triangles_center)
    part = trimesh.Trimesh(room.mesh.vertices, room.mesh.faces[seen], process=False)
    rest = trimesh.Trimesh(room.mesh.vertices, room.mesh.faces[~seen], process=False)
    assert 0 < seen.sum() < len(seen)
    whole, alone, without = (
        score_first_room(room, _run_with(tmp_path, room, mesh)).completion_ratio_5cm
        for mesh in (room.mesh, part, rest)
    )
    assert whole > 0.999 and without < alone <= whole


def test_what_another_run_lacks_is_left_out_of_a_comparison(room, tmp_path):
    """The second run has the part near the first camera, exact; the first also has the rest, 2 cm off."""
    centroids = room.mesh.triangles_center
    is_near = np.linalg.norm(centroids - room.truth.T_world_cam[0, :3, 3], axis=1) < 2.0
    part = trimesh.Trimesh(room.mesh.vertices, room.mesh.faces[is_near], process=False)
    far = trimesh.Trimesh(room.mesh.vertices, room.mesh.faces[~is_near], process=False)
    far.vertices = far.vertices - 0.02 * far.vertex_normals
    folders = [tmp_path / name for name in ("first", "second")]
    for folder, mesh in zip(folders, (trimesh.util.concatenate([part, far]), part), strict=True):
        folder.mkdir()
        _run_with(folder, room, mesh)
    whole = score_first_room(room, folders[0])
    same = score_first_room(room, *folders)
    assert whole.accuracy_mean_m > 3 * same.accuracy_mean_m


def test_a_source_without_a_true_mesh_is_refused(test_data):
    with pytest.raises(ValueError, match="expected a source with a true mesh"):
        first_room(f"tum:{test_data / 'livingroom'}", 20)


def test_the_world_of_the_truth_is_that_of_its_poses(room):
    assert np.allclose(inverse(room.truth.T_world_cam[0]) @ room.views.T_world_cam[0], np.eye(4))
