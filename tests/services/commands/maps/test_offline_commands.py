"""`hsslam-mesh` and `hsslam-render` on a map of the small room."""

import json
import resource
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.device.device import CPU
from hsslam_node.errors import UserError
from hsslam_node.evaluation.image_quality import psnr_db
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint, save_checkpoint
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_services.artefacts.mesh_file import mesh_of_arena
from hsslam_services.commands.maps import mesh as mesh_command
from hsslam_services.commands.maps import render as render_command
from tests.small_room import SMALL, mapped_room, room_frames, room_poses

_FILE_BYTES = 5000  # enough for an image, not for a video


@pytest.fixture(scope="module")
def saved(tmp_path_factory) -> Path:
    room = mapped_room()
    parameters, store = room.parameters, room.store
    path = tmp_path_factory.mktemp("map") / "room.safetensors"
    save_checkpoint(
        path,
        MapCheckpoint(
            parameters.layout,
            parameters.params.copy(),
            store.stamps_ns(),
            store.poses(),
            store.camera,
            SMALL.sampling,
        ),
    )
    return path


def test_camera_and_sampling_are_kept(saved):
    loaded = load_checkpoint(saved)
    assert (loaded.camera, loaded.sampling) == (room_frames()[0].camera, SMALL.sampling)


def test_the_mesh_lies_on_what_the_camera_measured(saved, tmp_path, capsys):
    out = tmp_path / "room.ply"
    mesh_command.main([str(saved), "--voxel", "0.04", "-o", str(out)])
    assert f"{out}: " in capsys.readouterr().out
    mesh = trimesh.load_mesh(out)
    assert len(mesh.faces) > 1000
    frame, T = room_frames()[0], room_poses()[0]
    v, u = np.mgrid[4:120:8, 4:160:8].reshape(2, -1)
    z = frame.depth_m()[v, u]
    camera = frame.camera
    points = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], 1)
    points = points[z > 0] @ T[:3, :3].T + T[:3, 3]
    distance_m = cKDTree(mesh.vertices).query(points)[0]
    assert np.median(distance_m) < 0.04


def test_the_mesh_of_a_map_with_images_is_that_of_the_service(saved, tmp_path):
    room = mapped_room()
    images = KeyframeImages.of(room.store)[1]
    checkpoint = replace(load_checkpoint(saved), images=images)
    path, out = tmp_path / "map.safetensors", tmp_path / "mesh.ply"
    save_checkpoint(path, checkpoint)
    mesh_command.main([str(path), "--voxel", "0.08", "-o", str(out), "--device", "cpu"])
    slam = replace(SMALL, mesher=replace(SMALL.mesher, final_voxel_m=0.08))
    of_service = mesh_of_arena(room.store, room.parameters, slam, CPU, lambda text: None)
    assert len(of_service.faces) > 500
    of_service.export(tmp_path / "service.ply")
    assert out.read_bytes() == (tmp_path / "service.ply").read_bytes()
    undecodable = replace(images, depth=np.zeros_like(images.depth))
    save_checkpoint(path, replace(checkpoint, images=undecodable))
    with pytest.raises(UserError, match="damaged map: keyframe 0"):
        SavedMap.open(path, "cpu").mesh()


def test_a_view_from_a_frame_looks_like_the_frame(saved, tmp_path, capsys):
    poses, out = tmp_path / "poses.txt", tmp_path / "views"
    write_tum(poses, Trajectory(np.arange(4) * 10**9, room_poses()[:4]))
    video = tmp_path / "flight.avi"
    arguments = ["--trajectory", str(poses), "--every", "2", "--out", str(out)]
    render_command.main([str(saved), *arguments, "--video", str(video)])
    assert sorted(path.name for path in out.iterdir()) == ["000000.png", "000001.png"]
    image = cv2.cvtColor(cv2.imread(str(out / "000000.png")), cv2.COLOR_BGR2RGB)
    true = room_frames()[0].color
    drawn = image.any(axis=2)
    assert image.shape == true.shape
    assert drawn.mean() > 0.8
    assert psnr_db(image[drawn] / 255.0, true[drawn] / 255.0) > 15
    assert video.stat().st_size > 1000
    told = _refused(render_command, [str(saved), *arguments], capsys)
    assert told == f"error: --out {out}: already has images: expected a new folder\n"


def test_colours_of_the_keyframes_are_nearer_to_the_frame_than_those_of_the_field(
    mapped_run, tmp_path
):
    poses = tmp_path / "poses.txt"
    write_tum(poses, Trajectory(np.zeros(1, np.int64), room_poses()[6:7]))
    errors = []
    for colors in ("keyframes", "field"):
        out = tmp_path / colors
        words = ["--trajectory", str(poses), "--colors", colors, "-o", str(out), "--device", "cpu"]
        render_command.main([str(mapped_run), *words])
        image = cv2.cvtColor(cv2.imread(str(out / "000000.png")), cv2.COLOR_BGR2RGB)
        errors.append(np.abs(image.astype(int) - room_frames()[6].color).mean())
    assert errors[0] < 0.9 * errors[1] and errors[0] < 2.4  # levels of 255; the field has 2.8


def test_a_video_that_the_disk_does_not_take_is_refused_and_the_older_one_stays(
    saved, tmp_path, capsys
):
    poses, video = tmp_path / "poses.txt", tmp_path / "flight.avi"
    write_tum(poses, Trajectory(np.arange(4) * 10**9, room_poses()[:4]))
    video.write_bytes(b"older")
    words = [str(saved), "--trajectory", str(poses), "--downscale", "4", "-o"]
    render_command.main(
        [*words, str(tmp_path / "before")]
    )  # what it compiles it writes to files, too
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (_FILE_BYTES, limits[1]))
    try:
        words += [str(tmp_path / "views"), "--video", str(video)]
        told = _refused(render_command, words, capsys)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert f"--video {video}: has " in told and "of 4 images: expected free space" in told
    assert video.read_bytes() == b"older"
    assert not list(tmp_path.glob(".flight*"))


def test_a_run_folder_stands_for_its_map(mapped_run, tmp_path, capsys):
    out = tmp_path / "room.ply"
    mesh_command.main([str(mapped_run), "--voxel", "0.1", "-o", str(out), "--device", "cpu"])
    poses, views = tmp_path / "poses.txt", tmp_path / "views"
    write_tum(poses, Trajectory(np.zeros(1, np.int64), room_poses()[:1]))
    more = ["--trajectory", str(poses), "--downscale", "4", "-o", str(views), "--device", "cpu"]
    render_command.main([str(mapped_run), *more])
    told = capsys.readouterr().out
    assert f"{out}: " in told and f"{views}: 1 images, 40 x 30 px" in told


@pytest.mark.parametrize("command", [mesh_command, render_command])
@pytest.mark.parametrize(
    ("damage", "text"),
    [
        ("missing", "no such file"),
        ("cut", "damaged map"),
        ("garbage", "not a map: expected a file such as map.safetensors"),
        ("version", "map version 9: expected 1 to 3"),
        ("camera", "damaged map"),
    ],
)
def test_a_bad_map_is_one_line_and_code_2(saved, tmp_path, capsys, command, damage, text):
    path = tmp_path / "map.safetensors"
    if damage != "missing":
        path.write_bytes(_damaged(saved.read_bytes(), damage))
    poses = tmp_path / "poses.txt"
    write_tum(poses, Trajectory(np.zeros(1, np.int64), np.eye(4)[None]))
    extra = ["--trajectory", str(poses)] if command is render_command else []
    told = _refused(command, [str(path), *extra], capsys)
    assert text in told and str(path) in told


@pytest.mark.parametrize(
    ("command", "arguments", "text"),
    [
        (mesh_command, (), "mesh: no map: expected a run folder or map.safetensors"),
        (render_command, (), "render: no map: expected a run folder or map.safetensors"),
        (mesh_command, ("m", "--voxel", "0"), "--voxel 0.0: expected 0.001 to 1 m"),
        (mesh_command, ("m", "-o", "x.txt"), "--out x.txt: expected a file .ply"),
        (mesh_command, ("m", "--voxle", "1"), "did you mean --voxel"),
        (render_command, ("m",), "--trajectory: missing"),
        (render_command, ("m", "--trajectory", "/nowhere"), "expected a trajectory in TUM format"),
        (render_command, ("m", "--video", "x.gif"), "--video x.gif: expected a file .mp4 or .avi"),
        (
            render_command,
            ("m", "--video", "/no/x.avi"),
            "--video /no/x.avi: expected a file .mp4 or .avi in a folder that exists",
        ),
    ],
)
def test_bad_input_is_one_line_and_code_2(capsys, command, arguments, text):
    assert text in _refused(command, arguments, capsys)


def _refused(command, arguments, capsys) -> str:
    with pytest.raises(SystemExit) as exit_:
        command.main(arguments)
    told = capsys.readouterr().err
    assert exit_.value.code == 2
    assert told.startswith("error: ") and told.count("\n") == 1, told
    return told


def _damaged(raw: bytes, how: str) -> bytes:
    if how == "cut":
        return raw[: len(raw) // 2]
    if how == "garbage":
        return b"\x80\x04pickle" * 100
    (length,) = struct.unpack("<Q", raw[:8])
    header = json.loads(raw[8 : 8 + length])
    header["__metadata__"] |= {"version": "9"} if how == "version" else {"camera": '{"fx": 1}'}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<Q", len(text)) + text + raw[8 + length :]
