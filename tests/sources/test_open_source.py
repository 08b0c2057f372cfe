"""From a spec to a source."""

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.source import SourceOptions


def test_opens_folders_by_kind(tum_folder, replica_folder):
    assert open_source(f"tum:{tum_folder}").frame_count == 5
    assert open_source(f"replica:{replica_folder}").frame_count == 4


def test_noise_wraps_the_source(replica_folder):
    source = open_source(f"replica:{replica_folder}", SourceOptions(noise="kinect"))
    assert "kinect" in source.name
    assert len(list(source.frames())) == 4


@pytest.mark.parametrize(
    ("spec", "suggestion"),
    [
        ("synt:room", "synth:room"),
        ("synth:rom", "synth:room"),
        ("tum:", "tum:"),
        ("zenoh", "zenoh:"),
    ],
)
def test_a_wrong_spec_suggests_the_nearest(spec, suggestion):
    with pytest.raises(UserError, match=f"did you mean {suggestion}"):
        open_source(spec)


def test_nothing_like_it_still_tells_what_is_expected():
    with pytest.raises(UserError, match="expected one of synth:room"):
        open_source("42")


@pytest.mark.parametrize(
    ("name", "archive"),
    [
        ("fr1/desk", "freiburg1/rgbd_dataset_freiburg1_desk.tgz"),
        ("fr2/xyz", "freiburg2/rgbd_dataset_freiburg2_xyz.tgz"),
        ("fr3/office", "freiburg3/rgbd_dataset_freiburg3_long_office_household.tgz"),
    ],
)
def test_a_missing_sequence_says_what_to_fetch_and_where_to_put_it(
    name, archive, monkeypatch, tmp_path
):
    monkeypatch.setenv("HSSLAM_DATA", str(tmp_path))
    with pytest.raises(UserError) as error:
        open_source(f"tum:{name}")
    assert archive in str(error.value)
    assert str(tmp_path) in str(error.value)
    monkeypatch.delenv("HSSLAM_DATA")
    with pytest.raises(UserError, match=r"HSSLAM_DATA is not set"):
        open_source(f"tum:{name}")
