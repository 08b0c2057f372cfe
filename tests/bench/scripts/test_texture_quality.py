"""The meshes whose colours the rows `texture` compare: exported by the command, read and drawn."""

import numpy as np

from hsslam_bench.scripts.texture_quality import exported
from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.mesh.mesh_view import MeshView
from hsslam_node.map.checkpoint import save_checkpoint
from tests.small_room import SMALL, mapped_room, room_frames, room_poses


def test_both_meshes_are_drawn_in_colour(tmp_path):
    room, frame = mapped_room(), room_frames()[10]
    checkpoint = map_snapshot(room.store, room.parameters, SMALL)
    save_checkpoint(tmp_path / "map.safetensors", checkpoint)
    for more in ((), ("--texture", "--texture-px", "1024")):
        mesh, seconds = exported(tmp_path, tmp_path / "mesh.glb", "--voxel", "0.06", *more)
        image, depth_m = MeshView(mesh).draw(frame.camera, room_poses()[10])
        hit = depth_m > 0
        assert hit.mean() > 0.8 and seconds > 0
        assert np.abs(image[hit] - frame.color[hit] / 255.0).mean() < 0.1
