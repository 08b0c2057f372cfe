"""`hsslam-log export`: its files are read by others' readers."""

import contextlib
import csv
import os
import re
import resource
import subprocess
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
import rerun_cli
import trimesh

from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import format_stamp, read_tum
from hsslam_node.geometry.triangles import triangle_mesh
from hsslam_node.sources.open_source import open_source
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_from_message
from hsslam_services.commands.log.command import main
from hsslam_services.log.frame_compression import compress_frame
from hsslam_services.log.parted_log import LogSettings, PartedLog
from tests.services.log.sample_log import START_NS, textured, write_log
from tests.services.recorded import rrd
from tests.services.wire_samples import frame, keyframe, pose


def test_the_folder_of_an_export_has_the_whole_name_of_its_run(tmp_path, monkeypatch, capsys):
    run = tmp_path / "noise0.5"
    run.mkdir()
    write_log(run, count=2)
    monkeypatch.chdir(run)
    for place in (".", "../noise0.5", str(run)):
        assert main(["export", place, "--only", "trajectory"]) == 0
        assert "noise0.5-export/trajectory.txt: 2 poses" in capsys.readouterr().out
    assert sorted(each.name for each in tmp_path.iterdir()) == ["noise0.5", "noise0.5-export"]


def test_an_export_to_a_full_disk_is_one_line_and_leaves_no_recording(tmp_path, disk):
    path, out = write_log(tmp_path, color="jpeg"), disk.folder / "out"
    out.mkdir()
    with (disk.folder / "ballast").open("wb", buffering=0) as ballast:
        for _ in range(2):  # what the file system holds back for the first is free after it
            with contextlib.suppress(OSError):
                while True:
                    ballast.write(bytes(2**16))
            os.fsync(ballast)
    words = ["export", str(path), "--only", "rrd", "--out", str(out)]
    run = [sys.executable, "-m", "hsslam_services.commands.log.command", *words]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    told = done.stderr.splitlines()[-1]
    assert told.startswith(f"error: {out}/run.rrd: No space left on device: ")
    assert not (out / "run.rrd").exists()


@pytest.mark.parametrize("name", ["trajectory_online.csv", "mesh.ply", "mesh.glb"])
def test_a_file_that_does_not_fit_leaves_the_older_one(tmp_path, capsys, name):
    path, older = write_log(tmp_path, count=4), tmp_path / "run-export" / name
    only = "mesh" if name.startswith("mesh") else "trajectory"
    assert main(["export", str(path), "--only", only]) == 0
    whole = older.read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) - 1, limits[1]))
    try:
        assert main(["export", str(path), "--only", only]) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "File too large: expected a folder to write to" in capsys.readouterr().err
    assert older.read_bytes() == whole
    assert not list(older.parent.glob(".*"))


def test_a_damaged_log_leaves_the_older_recording_and_no_list_of_frames(tmp_path, capsys):
    path, folder = write_log(tmp_path, color="jpeg"), tmp_path / "run-export"
    folder.mkdir()
    (folder / "run.rrd").write_text("older")
    whole = path.read_bytes()
    damaged = whole.index(compress_frame(textured(17), "jpeg").depth[-100:])
    path.write_bytes(whole[:damaged] + bytes(50) + whole[damaged + 50 :])
    for part in ("rrd", "frames"):
        assert main(["export", str(path), "--only", part]) == 2
        assert "damaged" in capsys.readouterr().err
    assert (folder / "run.rrd").read_text() == "older"
    assert sorted(each.name for each in folder.iterdir()) == ["frames", "run.rrd"]
    assert sorted(each.name for each in (folder / "frames").iterdir()) == ["depth", "rgb"]
    path.write_bytes(whole)
    assert main(["export", str(path), "--only", "frames"]) == 0
    assert len(list(open_source(f"tum:{folder / 'frames'}").frames())) == 20


def test_poses_of_two_map_epochs_are_exported_to_files_of_their_own(tmp_path, capsys):
    path = write_log(tmp_path, second_epoch_at=12)
    assert main(["export", str(path), "--only", "trajectory", "mesh"]) == 0
    folder = tmp_path / "run-export"
    counts = {
        name: len(read_tum(folder / name))
        for name in ("trajectory_online.epoch0.txt", "trajectory_online.txt")
    }
    assert list(counts.values()) == [11, 8]  # one was lost
    assert len(read_tum(folder / "keyframes.epoch0.txt")) == 3
    assert read_tum(folder / "keyframes.txt").positions.tolist() == [[3, 0, 0]]
    assert not (folder / "mesh.ply").exists()  # that of the log is of the first map epoch
    assert "no mesh" in capsys.readouterr().err
    with (folder / "trajectory_online.csv").open() as stream:
        epochs = [row["map_epoch"] for row in csv.DictReader(stream)]
    assert epochs == ["0"] * 12 + ["1"] * 8


def test_a_fragment_that_has_not_joined_is_a_trajectory_of_its_own(tmp_path):
    log = PartedLog(tmp_path, "r", LogSettings())

    def put(topic, message, **fields):
        log.write(topic, encode(topic, msgspec.structs.replace(message, **fields)), 1, 1, 1)

    for index, fragment in enumerate([0, 1, 1, 2, 2, 0]):
        put(topics.POSE, pose(index, "lost" if fragment else "tracked"), fragment=fragment)
    put(topics.KEYFRAME, keyframe(5), fragment=1, fragment_keyframe=0)
    log.close()
    assert main(["export", str(log.path), "--only", "trajectory"]) == 0
    folder = tmp_path / "run-export"
    apart = read_tum(folder / "trajectory_fragment_2.txt")
    assert apart.positions[:, 0].tolist() == [3, 4]
    assert len(read_tum(folder / "trajectory.txt")) == 4
    assert not (folder / "trajectory_fragment_1.txt").exists()
    with (folder / "trajectory_online.csv").open() as stream:
        assert [row["fragment"] for row in csv.DictReader(stream)] == [*"011220"]


def test_exported_trajectories_and_meshes_are_read_by_others(tmp_path):
    path = write_log(tmp_path)
    assert main(["export", str(path), "--only", "trajectory", "mesh"]) == 0
    folder = tmp_path / "run-export"
    assert sorted(file.name for file in folder.iterdir()) == [
        *("keyframes.txt", "mesh.glb", "mesh.ply"),
        *("trajectory.txt", "trajectory_online.csv", "trajectory_online.txt"),
    ]
    online = read_tum(folder / "trajectory_online.txt")
    np.testing.assert_array_equal(online.positions[:, 0], [k for k in range(20) if k != 3])
    assert online.stamps_ns[1] == 33_333_333
    assert read_tum(folder / "keyframes.txt").positions.tolist() == [
        *([0, 0, 0], [9, 8, 7], [2, 0, 0], [3, 0, 0])
    ]
    with (folder / "trajectory_online.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert (len(rows), rows[3]["status"], rows[4]["tx_m"]) == (20, "lost", "4.0")
    assert float(rows[4]["latency_ms"]) == pytest.approx(20, abs=1)
    ply = trimesh.load(folder / "mesh.ply", force="mesh", process=False)
    glb = triangle_mesh(folder / "mesh.glb", "a mesh")
    np.testing.assert_allclose(ply.vertices[2], [1, 1, 2])
    np.testing.assert_allclose(glb.vertices[2], [1, -1, -2])
    for mesh in (ply, glb):
        assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]]
        assert mesh.visual.vertex_colors[1].tolist() == [0, 255, 0, 255]


def test_nothing_of_another_log_stays_in_the_folder(tmp_path):
    other, folder = tmp_path / "other", tmp_path / "out"
    other.mkdir()
    logs = [write_log(tmp_path, second_epoch_at=12), write_log(other, count=4), tmp_path / "0.mcap"]
    assert main(["trim", str(logs[0]), str(logs[2]), "--end", "0.05"]) == 0  # no mesh
    only = ["--only", "trajectory", "mesh", "--out", str(folder)]
    (folder / "mine").mkdir(parents=True)
    (folder / "my_trajectory.txt").touch()
    for log, form in ((logs[0], "kitti"), (logs[0], "tum"), (logs[1], "tum"), (logs[2], "kitti")):
        assert main(["export", str(log), *only, "--format", form]) == 0
        if log == logs[1]:
            assert not list(folder.glob("*.epoch0.txt")) and (folder / "mesh.ply").exists()
    assert sorted(each.name for each in folder.iterdir()) == [
        *("keyframes.kitti.times.txt", "keyframes.kitti.txt", "keyframes.txt"),
        *("mine", "my_trajectory.txt", "trajectory.kitti.times.txt", "trajectory.kitti.txt"),
        *("trajectory.txt", "trajectory_online.csv", "trajectory_online.kitti.times.txt"),
        *("trajectory_online.kitti.txt", "trajectory_online.txt"),
    ]


def test_trajectories_come_in_the_format_that_is_wanted(tmp_path, capsys):
    path, folder = write_log(tmp_path), tmp_path / "out"
    only = ["--only", "trajectory", "--out", str(folder)]
    for kind in ("tum", "kitti", "euroc", "csv"):
        assert main(["export", str(path), *only, "--format", kind]) == 0
    final = read_tum(folder / "trajectory.txt")
    kitti = np.loadtxt(folder / "trajectory.kitti.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(kitti, final.T_world_cam[:, :3], atol=1e-8)
    times_s = (folder / "trajectory.kitti.times.txt").read_text().splitlines()
    assert times_s == [format_stamp(stamp_ns) for stamp_ns in final.stamps_ns.tolist()]
    euroc = (folder / "keyframes.euroc.csv").read_text().splitlines()[1:]
    assert [line.split(",")[1:4] for line in euroc][1] == [
        "9.000000000",
        "8.000000000",
        "7.000000000",
    ]
    online = (folder / "trajectory_online.euroc.csv").read_text().splitlines()
    assert online[2].startswith("33333333,1.000000000,")
    with (folder / "trajectory.csv").open() as stream:
        positions = [[float(row[f"t{axis}_m"]) for axis in "xyz"] for row in csv.DictReader(stream)]
    np.testing.assert_allclose(positions, final.positions, atol=1e-8)
    assert "status" in (folder / "trajectory_online.csv").read_text().splitlines()[0]


def test_exported_frames_open_again_as_a_tum_source(tmp_path):
    path = write_log(tmp_path)
    assert main(["export", str(path), "--only", "frames", "--out", str(tmp_path / "out")]) == 0
    source = open_source(f"tum:{tmp_path / 'out' / 'frames'}")
    found = list(source.frames())
    assert len(found) == 20
    for index, item in enumerate(found):
        assert isinstance(item, Frame)
        expected = frame_from_message(textured(index))
        assert (item.index, item.stamp_ns) == (index, expected.stamp_ns)
        assert item.camera == expected.camera
        assert item.depth_units_per_m == expected.depth_units_per_m
        np.testing.assert_array_equal(item.color, expected.color)
        np.testing.assert_array_equal(item.depth_raw, expected.depth_raw)


def test_frames_of_another_camera_are_exported_to_a_folder_of_their_own(tmp_path, capsys):
    log = PartedLog(tmp_path, "r", LogSettings("png"))
    for index in range(6):
        size = {"width_px": 32, "height_px": 24} if index >= 4 else {}
        payload = encode(topics.FRAME, compress_frame(frame(index, **size), "png"))
        log.write(topics.FRAME, payload, START_NS + index, START_NS + index, index)
    log.close()
    folder = tmp_path / "out"
    export = ["export", str(log.path), "--only", "frames", "--out", str(folder)]
    assert main(export) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"{folder}/frames: 4 frames, for --source tum:{folder}/frames",
        f"{folder}/frames-2: 2 frames, for --source tum:{folder}/frames-2",
    ]
    widths = [
        open_source(f"tum:{folder}/{name}").camera.width_px for name in ("frames", "frames-2")
    ]
    assert widths == [frame(0).width_px, 32]


@pytest.mark.parametrize(
    ("taken", "expected"),
    [
        ("frames/rgb.txt", "frames: already holds frames: expected a new folder"),
        ("run.rrd/x", "run.rrd: is a folder: expected a file"),
        ("run.json", "out: is a run folder, whose results stay: expected another folder"),
        ("map.safetensors", "out: is a run folder, whose results stay: expected another"),
    ],
)
def test_an_export_whose_place_is_taken_writes_nothing(tmp_path, capsys, taken, expected):
    in_the_way = tmp_path / "out" / taken
    in_the_way.parent.mkdir(parents=True)
    in_the_way.touch()
    assert main(["export", str(write_log(tmp_path)), "--out", str(tmp_path / "out")]) == 2
    told = capsys.readouterr().err
    assert expected in told and told.count("\n") == 1
    (left,) = (tmp_path / "out").iterdir()
    assert in_the_way.is_relative_to(left)


def test_the_exported_recording_is_whole_for_rerun(tmp_path):
    path = write_log(tmp_path, color="jpeg")
    assert main(["export", str(path), "--only", "rrd"]) == 0
    recording = tmp_path / "run-export" / "run.rrd"
    rerun = Path(rerun_cli.__file__).parent / "rerun"
    subprocess.run([rerun, "rrd", "verify", recording], check=True, capture_output=True)
    printed = subprocess.run(
        [rerun, "rrd", "print", "-vv", recording], check=True, capture_output=True, text=True
    ).stdout
    for entity in ("/world/mesh", "/world/camera/image", "/world/keyframes/0", "/events"):
        assert entity in printed


def test_a_recording_has_the_id_of_its_log_wherever_that_lies(tmp_path, capsys):
    ids = []
    for day, run_id in (("monday", "1"), ("tuesday", "2"), ("copy", "1")):
        folder = tmp_path / day / "desk"
        folder.mkdir(parents=True)
        path = write_log(folder, count=2, color="jpeg", metadata={"run_id": run_id})
        assert main(["export", str(path), "--only", "rrd"]) == 0
        recording = folder / "run-export" / "run.rrd"
        ids += set(re.findall(r'Recording,\s+"hsslam",\s+"(.+)"', rrd("print", recording)))
        assert "[desk/run.mcap]" in rrd("print", "-vvv", recording)
    monday, tuesday, copy = ids
    assert monday == copy != tuesday
    short = tmp_path / "desk.mcap"
    assert main(["trim", str(path), str(short), "--end", "0.05"]) == 0
    assert main(["export", str(short), "--only", "rrd"]) == 0
    assert monday not in rrd("print", tmp_path / "desk-export" / "run.rrd")


def test_a_recording_may_be_of_a_folder_whose_name_is_not_utf8(tmp_path):
    folder = tmp_path / os.fsdecode(b"desk\xff")
    folder.mkdir()
    path = write_log(folder, count=2, color="jpeg")
    assert main(["export", str(path), "--only", "rrd", "--out", str(tmp_path / "out")]) == 0
    assert "[desk\ufffd/run.mcap]" in rrd("print", "-vvv", tmp_path / "out" / "run.rrd")


def test_a_live_mesh_is_told_as_one(tmp_path, capsys):
    whole = write_log(tmp_path)
    assert main(["trim", str(whole), str(tmp_path / "begin.mcap"), "--end", "1"]) == 0
    for log, is_live in ((tmp_path / "begin.mcap", True), (whole, False)):
        assert main(["export", str(log), "--only", "mesh", "--out", str(tmp_path / log.stem)]) == 0
        assert ("no final mesh" in capsys.readouterr().err) == is_live
        assert (tmp_path / log.stem / "mesh.ply").exists()
