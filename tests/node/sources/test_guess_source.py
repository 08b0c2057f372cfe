"""A folder or file named without its kind, or with a wrong one: the nearest source is told."""

from pathlib import Path

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.guess_source import guess_source
from hsslam_node.sources.open_source import open_source

_LAYOUTS = {
    "tum": ("rgb.txt", "depth.txt", "rgb/", "depth/"),
    "replica": ("traj.txt", "results/"),
    "scannet": ("color/", "depth/", "pose/", "intrinsic/"),
    "record": ("rgb/", "depth/"),
    "mcap": ("run.mcap",),
}


@pytest.mark.parametrize("kind", _LAYOUTS)
def test_a_folder_is_known_by_what_lies_in_it(kind: str, tmp_path: Path):
    for name in _LAYOUTS[kind]:
        path = tmp_path / name
        path.mkdir() if name.endswith("/") else path.touch()
    assert guess_source(str(tmp_path)) == f"{kind}:{tmp_path}"
    with pytest.raises(UserError, match=f"did you mean {kind}:{tmp_path}"):
        open_source(str(tmp_path))
    if kind not in ("tum", "record"):
        with pytest.raises(UserError, match=f"did you mean {kind}:{tmp_path}"):
            open_source(f"tum:{tmp_path}")


def test_what_is_no_source_is_not_guessed_at(tmp_path: Path):
    assert guess_source(str(tmp_path)) == ""
    assert guess_source(str(tmp_path / "scene.sens")) == ""
    assert guess_source("") == ""
    (tmp_path / "scene.sens").touch()
    assert guess_source(str(tmp_path / "scene.sens")) == f"scannet:{tmp_path}/scene.sens"
    with pytest.raises(UserError) as caught:
        open_source(f"tum:{tmp_path}")
    assert "did you mean" not in str(caught.value)
