"""Camera files: every field is checked and named."""

import json

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.files.camera_file import (
    read_record_camera,
    read_replica_camera,
    read_tum_camera,
)
from hsslam_node.sources.options.camera import CameraOptions
from tests.sequence_folders import write_tum_camera


def test_reads_a_camera(tmp_path):
    write_tum_camera(tmp_path, distortion=[0.1, -0.2, 0.0, 0.0, 0.3], depth_scale=None)
    camera, scale = read_tum_camera(tmp_path / "camera.json")
    assert (camera.width_px, camera.fx, camera.distortion[0], scale) == (64, 50.0, 0.1, 5000.0)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_reads_the_lenses_of_opencv(tmp_path, count):
    lens = [0.01 * (k + 1) for k in range(count)]
    write_tum_camera(tmp_path, distortion=lens)
    camera, _ = read_tum_camera(tmp_path / "camera.json")
    assert (camera.distortion, camera.distortion_model) == (tuple(lens), "opencv")
    write_tum_camera(tmp_path, distortion=count * [0])
    assert read_tum_camera(tmp_path / "camera.json")[0].distortion == ()


def test_reads_an_equidistant_lens(tmp_path):
    write_tum_camera(tmp_path, distortion=[0, 0, 0, 0], distortion_model="equidistant")
    camera, _ = read_tum_camera(tmp_path / "camera.json")
    assert (camera.distortion, camera.distortion_model) == ((0.0,) * 4, "equidistant")
    assert camera.has_lens  # the images are no pinhole's even if all coefficients are 0


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"fx": float("nan")}, "fx = nan"),
        ({"cy": None}, "'cy' is missing"),
        ({"fy": -3.0}, "fy = -3"),
        ({"width": 64.5}, "width"),
        ({"cx": "middle"}, "cx = middle"),
        ({"depth_scale": 0}, "depth_scale"),
        ({"fx": True}, "fx = True: expected a number above 0"),
        (
            {"distortion": [0.1]},
            r"distortion = \[0.1\] \(1 numbers\): expected 0 or 4 or 5 or 8 or 12",
        ),
        ({"distortion": [0.1] * 4 + ["k3"]}, "distortion = .*'k3'.*: expected a list of finite"),
        ({"distortion": [0, 0, 0, float("inf")]}, "distortion = .*inf"),
        (
            {"distortion_model": "fisheye"},
            "distortion_model = fisheye: expected opencv or equidist",
        ),
        ({"distortion_model": "equidistant"}, r"distortion = \[\] .*: expected 4 numbers"),
        ({"depth_scal": 1000}, "unknown field 'depth_scal': .*did you mean depth_scale"),
    ],
)
def test_a_wrong_field_is_named_with_its_file(tmp_path, changes, field):
    write_tum_camera(tmp_path, **changes)
    with pytest.raises(UserError, match=field) as error:
        read_tum_camera(tmp_path / "camera.json")
    assert str(tmp_path / "camera.json") in str(error.value)


def test_options_mean_the_same_whatever_the_file_has(tmp_path):
    write_tum_camera(tmp_path, distortion=[0.1, 0, 0, 0], distortion_model="equidistant")

    def camera(**options):
        given = CameraOptions(**options).given()
        return read_record_camera(tmp_path / "camera.json", given, (64, 48))[0]

    assert (camera(fx=300.0).fx, camera(fx=300.0).fy) == (300, 300)
    assert camera(fy=300.0).fx == camera().fx
    for count in (4, 5):
        lens = (-0.2, 0.05, 0.0, 0.0, 0.0)[:count]
        found = camera(distortion=lens)
        assert (found.distortion, found.distortion_model) == (lens, "opencv")
    with pytest.raises(UserError, match=r"^--camera\.fx = 10000000000\.0: expected a number"):
        camera(fx=1e10)
    write_tum_camera(tmp_path)
    with pytest.raises(UserError, match=r"^--camera\.distortion-model equidistant: distortion = "):
        camera(distortion_model="equidistant")


@pytest.mark.parametrize("text", ["", "[]", "{"])
def test_not_a_camera_at_all(tmp_path, text):
    (tmp_path / "camera.json").write_text(text)
    with pytest.raises(UserError, match=r"camera\.json"):
        read_tum_camera(tmp_path / "camera.json")


def test_replica_fields_are_checked(tmp_path):
    path = tmp_path / "cam_params.json"
    path.write_text(json.dumps({"camera": {"w": 64, "h": 48, "fx": 1, "fy": 1, "cx": 0, "cy": 0}}))
    with pytest.raises(UserError, match="'scale' is missing"):
        read_replica_camera(path)
    path.write_text("{}")
    with pytest.raises(UserError, match="'camera' is missing"):
        read_replica_camera(path)
