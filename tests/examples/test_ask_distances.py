"""The example that asks a map, as a user runs it."""

import re
import runpy

import pytest

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from tests.in_process import run_script
from tests.repository import ROOT

EXAMPLE = ROOT / "examples/ask_distances.py"


def test_it_maps_and_asks_and_keeps_the_map(tmp_path):
    kept = tmp_path / "map.safetensors"
    done = run_script(EXAMPLE, "synth:room", "3", str(kept))
    assert done.returncode == 0, done.stderr
    first, *places, ball, crate, last = done.stdout.splitlines()
    (wall_m,) = map(float, re.findall(r"a surface after (\d\.\d\d) m", first))
    assert 1.0 < wall_m < 6.0
    assert len(places) == 5 and "to the nearest surface" in places[0]
    assert ball.startswith("a ball of 20 cm fits at [") and crate.startswith("a crate of 30 cm")
    assert last == f"{kept}: {len(SavedMap.open(kept, 'cpu').keyframes)} keyframes"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("nothing:",), "error: "),
        (("a", "1", "b", "c"), "ask_distances.py"),
        (("synth:room", "ten"), "error: ten: expected a number of frames"),
        (("synth:room", "0"), "error: 0: expected a number of frames, 1 or more"),
    ],
)
def test_bad_input_is_one_line(arguments, text):
    done = run_script(EXAMPLE, *arguments)
    assert done.returncode == 1
    assert text in done.stderr and "Traceback" not in done.stderr


def test_a_source_without_a_tracked_frame_is_told():
    ask = runpy.run_path(str(EXAMPLE))["ask"]
    with pytest.raises(
        UserError, match="no frame was tracked: expected a source whose frames have"
    ):
        ask(Slam(PRESETS["realtime"]))
