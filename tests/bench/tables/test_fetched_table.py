"""One command fetches what is public and makes a table of the paper."""

import io
import json
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_bench.tables.command import table_command
from hsslam_bench.tables.options import TableOptions
from hsslam_bench.tables.paper_tables import ABLATION, TUM
from hsslam_bench.tables.plan import plan_table
from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import Trajectory, format_stamp, write_tum
from tests.sequence_folders import write_tum_camera
from tests.small_room import room_frames, room_poses

_DESK = "rgbd_dataset_freiburg1_desk"
_TINY = ("mapper.first_iterations=20", "mapper.rays=256", "mesher.final_voxel_m=0.1")
_SMALL = ("--frames", "4", "--preset", "realtime", "--seeds", "0", "--set", *_TINY)


@pytest.fixture
def archive(tmp_path: Path) -> bytes:
    """Four frames of the built-in room, packed as the site packs its sequences."""
    folder = tmp_path / "packed" / _DESK
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    frames = room_frames()[:4]
    for frame in frames:
        for kind, image in (("rgb", frame.color[..., ::-1]), ("depth", frame.depth_raw)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / kind / f"{frame.index}.png"), image)
            lists[kind].append(f"{format_stamp(frame.stamp_ns)} {kind}/{frame.index}.png")
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    stamps_ns = np.array([frame.stamp_ns for frame in frames])
    write_tum(folder / "groundtruth.txt", Trajectory(stamps_ns, room_poses()[:4]))
    c = frames[0].camera
    size = {"width": c.width_px, "height": c.height_px}
    lens = {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    write_tum_camera(folder, **size, **lens, depth_scale=frames[0].depth_units_per_m)
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:gz") as file:
        file.add(folder, _DESK)
    return data.getvalue()


def test_a_table_of_tum_is_fetched_and_measured(
    archive, serve_files, fetched: Path, tmp_path: Path, monkeypatch, capsys
):
    server = serve_files({f"/freiburg1/{_DESK}.tgz": archive})
    monkeypatch.setenv("HSSLAM_TUM_URL", server.url)
    out = tmp_path / "tum.json"
    command = ("--fetch", "--rows", "fr1/desk", *_SMALL, "--out", str(out))
    assert table_command("tum", command) == 0, capsys.readouterr().out
    (run,) = json.loads(out.read_text())["runs"]
    assert (run["row"], run["error"]) == ("fr1/desk", "")
    assert run["values"]["ate_cm"] < 5
    assert [path.name for path in fetched.iterdir()] == [_DESK]
    assert "| fr1/desk |" in out.with_suffix(".md").read_text()

    plan = plan_table(TUM, TableOptions(fetch=True, rows=("fr1/desk",), seeds=(0,)))
    assert [job.source for job in plan.jobs] == [f"tum:{fetched / _DESK}"]
    assert len(server.asked) == 1  # what is on disk is not fetched again


def test_without_fetch_nothing_is_asked_for(serve_files, monkeypatch, tmp_path: Path):
    server = serve_files({})
    monkeypatch.setenv("HSSLAM_TUM_URL", server.url)
    plan = plan_table(TUM, TableOptions(data=tmp_path))
    assert not plan.jobs and len(plan.skipped) == 3
    assert all("docs/sequences.md" in line for line in plan.skipped)
    assert not server.asked


def test_what_cannot_be_fetched_is_told_in_one_line(serve_files, monkeypatch, fetched: Path):
    server = serve_files({})
    monkeypatch.setenv("HSSLAM_TUM_URL", server.url)
    with pytest.raises(UserError, match=r"tum:fr1/desk: .*404.*by hand") as error:
        plan_table(TUM, TableOptions(fetch=True))
    assert "\n" not in str(error.value)


def test_tum_stands_for_its_sequences_in_the_ablation(fetched: Path):
    for name in (_DESK, "rgbd_dataset_freiburg2_xyz"):
        (fetched / name).mkdir(parents=True)
    options = TableOptions(sequences=("tum", "room"), rows=("full",), seeds=(0,))
    plan = plan_table(ABLATION, options)
    assert [job.sequence for job in plan.jobs] == ["fr1/desk", "fr2/xyz", "room"]
    assert plan.skipped[0].startswith("skipped fr3/office: ")
