"""Run folders of every kind of source are scored by the frames of their run."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import write_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.camera import CameraOptions
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_codec import frame_message
from hsslam_services.commands.evaluate.command import main
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.run.options import ServeOptions
from hsslam_services.run.run_info import RunInfo
from tests.services.camera.bags.ros_bags import written

_ROOM = SourceOptions(frames=21, synth=SynthOptions(width_px=96, height_px=72))


@pytest.fixture(scope="module")
def room() -> list[Frame]:
    return [f for f in open_source("synth:room", _ROOM).frames() if isinstance(f, Frame)]


def test_the_run_of_a_bag(room, tmp_path, capsys):
    bag = written(tmp_path, "db3", room)
    camera = CameraOptions(depth_scale=room[0].depth_units_per_m)
    folder = _run(tmp_path / "run", ServeOptions(f"bag:{bag}", camera=camera, evaluate=False))
    _expect_agreement(str(folder), tmp_path=tmp_path)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("source", ["tum:frames", "mcap:other"])
def test_a_source_that_is_not_there_is_told_with_the_run(source, tmp_path, monkeypatch, capsys):
    """As from another folder than that in which the run began."""
    monkeypatch.chdir(tmp_path)
    folder = _run(tmp_path / "run", ServeOptions(source, evaluate=False))
    with pytest.raises(SystemExit) as end:
        main([str(folder)])
    told = capsys.readouterr().err
    assert end.value.code == 2 and told.count("\n") == 1
    assert told.startswith(f"error: {folder}: its source cannot be read: ")
    assert "a relative path counts from the folder in which the run began" in told


@pytest.mark.parametrize("source", ["ros2:/camera", "zenoh:"])
def test_the_run_of_a_camera_is_scored_by_its_log(source, room, tmp_path, capsys):
    options = ServeOptions(source, evaluate=False)
    folder = _run(tmp_path / "run", options)
    log = PartedLog(
        folder, "r", LogSettings(metadata={"options": msgspec.json.encode(options).decode()})
    )
    for frame in room:
        payload = encode(topics.FRAME, frame_message(frame, frame.stamp_ns))
        log.write(topics.FRAME, payload, frame.stamp_ns, frame.stamp_ns, frame.index)
    log.close()
    _expect_agreement(str(folder), tmp_path=tmp_path)
    again = _run(tmp_path / "again", replace(options, source=f"mcap:{folder}"))
    _expect_agreement(str(again), tmp_path=tmp_path)
    trajectory = ("--trajectory", str(folder / "trajectory.txt"))
    _expect_agreement(*trajectory, "--source", f"mcap:{folder}", tmp_path=tmp_path)
    capsys.readouterr()
    (folder / "run.mcap").unlink()
    for args, expected in (
        ([str(folder)], f"{folder}: nothing to score: --source {source} cannot be read again"),
        ([*trajectory, "--source", source], f"--source {source}: its frames cannot be read again"),
    ):
        with pytest.raises(SystemExit) as end:
            main(args)
        told = capsys.readouterr().err
        assert end.value.code == 2 and told.count("\n") == 1 and expected in told


def _run(folder: Path, options: ServeOptions) -> Path:
    """What a run with the true poses leaves beside its log."""
    truth = open_ground_truth("synth:room", _ROOM)
    assert truth is not None
    folder.mkdir()
    RunInfo("id", str(folder), "/a", "tcp/h:1", "r", 1, 2, options).write()
    write_tum(folder / "trajectory.txt", truth.trajectory)
    return folder


def _expect_agreement(*args: str, tmp_path: Path) -> None:
    """The first, eleventh and last frame agree with each other."""
    main([*args, "--json", str(tmp_path / "score.json")])
    figures: dict[str, Any] = json.loads((tmp_path / "score.json").read_text())
    near = figures["consistency"]["estimated"][0]
    assert (near["gap_frames"], near["pairs"], near["possible"]) == (10, 2, 2)
    assert near["depth_median_m"] < 0.01
