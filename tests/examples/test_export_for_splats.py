"""The example that exports a map for Gaussian splats, as a user runs it."""

import re

import cv2

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.map.checkpoint import save_checkpoint
from tests.in_process import run_script
from tests.repository import ROOT
from tests.small_room import SMALL, mapped_room

EXAMPLE = ROOT / "examples/export_for_splats.py"


def test_the_points_look_like_the_first_image(tmp_path):
    room, out = mapped_room(), tmp_path / "splats"
    checkpoint = map_snapshot(room.store, room.parameters, SMALL)
    save_checkpoint(tmp_path / "map.safetensors", checkpoint)
    done = run_script(EXAMPLE, str(tmp_path), str(out))
    assert done.returncode == 0, done.stderr
    assert f"10 images for ns-train splatfacto --data {out}\n" in done.stdout
    found = re.search(r"points cover (\d+)% of the first image, (\d+) of 255 off", done.stdout)
    assert found is not None
    share, difference = map(int, found.groups())
    assert share > 70 and difference < 40
    picture = cv2.imread(str(out / "start.png"))
    assert picture is not None and picture.shape == (120, 320, 3)


def test_bad_input_is_one_line(tmp_path):
    assert "export_for_splats.py" in run_script(EXAMPLE).stderr
    done = run_script(EXAMPLE, str(tmp_path / "nowhere"))
    assert done.returncode == 2
    assert done.stderr.startswith("error: ") and done.stderr.count("\n") == 1
