"""A camera plugin with a fault: the run ends with one line that names the fault."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.services.run.installed_package import install
from tests.services.serve_process import QUICK

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
        self.name, self._indices = f"odd:{name}", name.split(",")

    def frames_in_time(self, first, is_late):
        items = super().frames_in_time(first, is_late)
        for item, index in zip(items, self._indices[first:]):
            if index == "end":
                return
            yield replace(item, index=int(index))
"""


def _serve(tmp_path: Path, source: str) -> subprocess.CompletedProcess[str]:
    site, out = tmp_path / "site", tmp_path / "run"
    install(site, "hsslam-odd", {"hsslam_odd": _PLUGIN}, {"odd": "hsslam_odd:ROW"})
    command = [sys.executable, "-m", "hsslam_services.commands.serve"]
    options = ["--source", source, "--pace", "lockstep", "--no-evaluate", "--out", str(out)]
    return subprocess.run(
        [*command, *options, *QUICK],
        env=os.environ | {"PYTHONPATH": f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"},
        capture_output=True,
        text=True,
        timeout=200,
    )


def test_frames_whose_indices_do_not_grow(tmp_path: Path):
    done = _serve(tmp_path, "odd:0,1,1")
    assert "the frame after frame 1 has index 1: expected 2 or more" in done.stderr
    assert "Traceback" not in done.stderr
    assert done.returncode == 3


@pytest.mark.long
def test_a_source_that_ends_early(tmp_path: Path):
    done = _serve(tmp_path, "odd:0,1,end,3")
    assert "source odd:0,1,end,3 ended after 2 of 4 frames" in done.stderr
    assert done.returncode == 0


@pytest.mark.long
def test_a_source_without_frames(tmp_path: Path):
    done = _serve(tmp_path, "odd:end,1")
    assert "error: source odd:end,1: no frame came: expected 2" in done.stderr
    assert done.returncode == 2
