"""A camera plugin with a fault: the run ends with one line that names the fault."""

import os
import subprocess
import sys
from pathlib import Path

from tests.services.run.installed_package import install

_PLUGIN = """
import itertools
from dataclasses import replace

from hsslam_node.sources.source_row import SourceRow
from hsslam_node.sources.synth import SynthSource
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

ROW = SourceRow(kind="odd", examples=("odd:INDICES",), brief="odd indices", about="odd indices",
                opener="hsslam_odd:Odd")

class Odd(SynthSource):
    def __init__(self, name, options):
        small = SynthOptions(width_px=160, height_px=120)
        super().__init__("room", SourceOptions(frames=len(name.split(",")), synth=small))
        self.name, self._indices = f"odd:{name}", [int(index) for index in name.split(",")]

    def frames_in_time(self, first, is_late):
        items = super().frames_in_time(first, is_late)
        for item, index in zip(items, self._indices[first:]):
            yield replace(item, index=index)
"""


def test_frames_whose_indices_do_not_grow(tmp_path: Path):
    site, out = tmp_path / "site", tmp_path / "run"
    install(site, "hsslam-odd", {"hsslam_odd": _PLUGIN}, {"odd": "hsslam_odd:ROW"})
    command = [sys.executable, "-m", "hsslam_services.commands.serve"]
    options = ["--source", "odd:0,1,1", "--pace", "lockstep", "--no-evaluate", "--out", str(out)]
    done = subprocess.run(
        [*command, *options],
        env=os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert "the frame after frame 1 has index 1: expected 2 or more" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 3
