"""From a spec to a source."""

import re

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions


def test_opens_folders_by_kind(tum_folder, replica_folder):
    assert open_source(f"tum:{tum_folder}").frame_count == 5
    assert open_source(f"replica:{replica_folder}").frame_count == 4


def test_noise_wraps_the_source(replica_folder):
    source = open_source(f"replica:{replica_folder}", SourceOptions(noise="kinect"))
    assert "kinect" in source.name
    assert len(list(source.frames())) == 4


@pytest.mark.parametrize(
    ("camera", "option"),
    [
        (CameraOptions(fx=500.0), "--camera.fx 500.0"),
        (CameraOptions(depth_scale=1000.0), "--camera.depth-scale 1000.0"),
        (CameraOptions(distortion=(0.1, 0, 0, 0)), "--camera.distortion 0.1 0 0 0"),
    ],
)
def test_options_of_the_camera_are_refused_where_the_source_does_not_read_them(
    tum_folder, replica_folder, camera, option
):
    for spec in (f"tum:{tum_folder}", f"replica:{replica_folder}", "synth:room"):
        expected = f"{option}: source {spec} has its own camera: expected no --camera option"
        with pytest.raises(UserError, match=re.escape(expected)):
            open_source(spec, SourceOptions(camera=camera))


@pytest.mark.parametrize(
    ("spec", "suggestion"),
    [
        ("synt:room", "synth:room"),
        ("synth:rom", "synth:room"),
        ("tum:", "tum:"),
    ],
)
def test_a_wrong_spec_suggests_the_nearest(spec, suggestion):
    with pytest.raises(UserError, match=f"did you mean {suggestion}"):
        open_source(spec)


def test_nothing_like_it_still_tells_what_is_expected():
    with pytest.raises(UserError, match="expected one of synth:room"):
        open_source("42")
