"""Values of a data set, and boxes: what the tables run with, and that they say so."""

import numpy as np
import pytest

from hsslam_bench.results.report import machine
from hsslam_bench.tables.command import table_command
from hsslam_bench.tables.options import TableOptions, with_overrides
from hsslam_bench.tables.paper_tables import TABLES
from hsslam_bench.tables.plan import RunResult, plan_table
from hsslam_bench.tables.published.scene_settings import settings_of
from hsslam_bench.tables.result_file import ResultFile
from hsslam_bench.tables.table_run import bound_in_box
from hsslam_node.evaluation.ground_truth import GroundTruth
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.presets import PRESETS, PresetName

_EVERY = [(table.name, row.name) for table in TABLES.values() for row in table.rows]
_SEQUENCES = [name for table, name in _EVERY if table != "ablation"]


def _config(preset, sequence):
    return with_overrides(PRESETS[preset], settings_of(preset, sequence).overrides)


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("sequence", [*_SEQUENCES, "house", "kitchen", "room"])
def test_every_sequence_has_values_that_a_preset_can_have(preset, sequence):
    _config(preset, sequence)
    settings = settings_of(preset, sequence)
    if preset == "realtime":
        assert not settings.overrides and not settings.box and not settings.protocol
    elif sequence in _SEQUENCES:
        assert len(settings.box) == 6 and "box by hand" in settings.protocol


def test_the_data_sets_have_the_values_of_the_files():
    paper, desk, scene = (_config("paper", name) for name in ("room0", "fr1/desk", "scene0000_00"))
    tracking = [
        (c.rendering_tracker.iterations, c.rendering_tracker.translation_rate)
        for c in (paper, desk, scene)
    ]
    assert tracking == [(8, 2e-3), (20, 1e-2), (30, 5e-4)]
    assert [c.mapper.iterations for c in (paper, desk, scene)] == [15, 20, 30]
    assert [c.weights.smoothness for c in (paper, desk, scene)] == [1e-6, 1e-8, 1e-3]
    assert [c.sampling.count for c in (paper, desk, scene)] == [40, 56, 56]
    assert [round(640 * c.rendering_tracker.border) for c in (paper, desk, scene)] == [40, 35, 85]
    assert [c.mesher.final_voxel_m for c in (paper, scene)] == [0.01, 0.02]
    eslam = _config("eslam", "fr2/xyz")
    assert (eslam.rendering_tracker.iterations, eslam.rendering_tracker.pixels) == (200, 5000)
    assert (eslam.keyframes.every_frames, eslam.mapper.iterations, eslam.mapper.rays) == (
        1,
        60,
        5000,
    )
    co_slam = _config("co-slam", "scene0059_00")
    assert co_slam.field.hash_table_log2 == 12 and co_slam.weights.blind_color == 0
    assert _config("co-slam", "scene0106_00").field.hash_table_log2 == 14


def test_a_job_has_the_values_of_its_sequence_and_what_the_user_sets_wins(tmp_path):
    (tmp_path / "rgbd_dataset_freiburg1_desk").mkdir()
    (tmp_path / "room0").mkdir()
    options = TableOptions(
        data=tmp_path, rows=("full", "D"), sequences=("fr1/desk", "room0"), seeds=(0,),
        set=("mapper.iterations=3",),
    )  # fmt: skip
    desk, room, desk_D, _ = plan_table(TABLES["ablation"], options).jobs
    assert (desk.sequence, desk.config.rendering_tracker.iterations) == ("fr1/desk", 20)
    assert (room.sequence, room.config.rendering_tracker.iterations) == ("room0", 8)
    assert {job.config.mapper.iterations for job in (desk, room)} == {3}
    assert not desk_D.config.field.hash_levels and desk_D.config.rendering_tracker.iterations == 20
    assert desk.protocol.endswith("noise none; values of TUM RGB-D; a box by hand")
    assert room.protocol.endswith("noise none; values of Replica; a box by hand")
    realtime = TableOptions(data=tmp_path, preset="realtime", rows=("full",), sequences=("room0",))
    (job, *_) = plan_table(TABLES["ablation"], realtime).jobs
    assert job.config == PRESETS["realtime"] and not job.box
    assert job.protocol == realtime.protocol


def test_the_first_camera_stands_in_the_box_as_it_does_in_the_truth(tmp_path):
    (tmp_path / "room0").mkdir()
    options = TableOptions(data=tmp_path, rows=("room0",), seeds=(0,))
    (job,) = plan_table(TABLES["replica"], options).jobs
    T = se3_exp(np.array([1.0, 0.2, -0.3, 0.4, -1.0, 0.3]))
    truth = GroundTruth(Trajectory(np.array([0, 1]), np.stack([T, np.eye(4)])))
    bound = bound_in_box(job, truth)
    assert bound.box == (-1.0, -1.3, -1.7, 7.0, 3.7, 1.4)
    np.testing.assert_array_equal(np.reshape(bound.first_camera, (3, 4)), T[:3])
    assert bound_in_box(job, None) == job.config.bound  # a box is of no use without a place in it


def test_the_table_says_its_values_and_its_preset(tmp_path, capsys):
    (tmp_path / "rgbd_dataset_freiburg1_desk").mkdir()
    out, where = tmp_path / "t.json", ("--rows", "full", "--seeds", "0", "--sequences", "fr1/desk")
    titles: dict[PresetName, str] = {"realtime": "preset realtime", "paper": "HS-SLAM"}
    for preset, title in titles.items():
        options = TableOptions(
            data=tmp_path, preset=preset, rows=("full",), seeds=(0,), sequences=("fr1/desk",)
        )
        (job,) = plan_table(TABLES["ablation"], options).jobs
        found = {
            name: getattr(job, name) for name in ("key", "row", "sequence", "seed", "protocol")
        }
        result = RunResult(**found, commit="c", values={"ate_cm": 1.25})
        ResultFile(out, "ablation").add(result, machine())
        arguments = [*where, "--preset", preset, "--data", str(tmp_path), "--out", str(out)]
        assert table_command("ablation", [*arguments, "--show"]) == 0
        assert f"Ablation (Table II), preset {preset}" in capsys.readouterr().out
        text = out.with_suffix(".md").read_text()
        assert f"| {title} |" in text and "| 1.250 (" in text
        values = "fr1/desk: values of TUM RGB-D: rendering_tracker.translation_rate = 0.01, "
        assert (values in text) == (preset == "paper")
