"""The tutorial's commands, run as they are printed, on a small recording."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hsslam_node.frame import Frame
from hsslam_node.geometry.trajectory import read_tum
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_services.bus.bus import free_endpoint
from tests.repository import ROOT

TUTORIAL = ROOT / "docs/tutorial.md"
FRAMES = 24
_QUICKLY = "--slam.mapper.first-iterations 40"  # the quality of the map is no matter here
# at 640x480, and of the small frames
_INTRINSICS = {"525": "131.25", "319.5": "79.5", "239.5": "59.5"}


def record(folder: Path) -> None:
    """A short way through the room, as somebody's program would save it: depth in millimetres."""
    for kind in ("color", "depth"):
        (folder / kind).mkdir(parents=True)
    room = SourceOptions(frames=FRAMES, synth=SynthOptions(width_px=160, height_px=120))
    for frame in open_source("synth:room", room).frames():
        assert isinstance(frame, Frame)
        name = f"{frame.index:04d}.png"
        cv2.imwrite(str(folder / "color" / name), frame.color[..., ::-1])
        depth_mm = np.rint(frame.depth_m() * 1000).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / name), depth_mm)


@pytest.mark.e2e
def test_the_tutorial(tmp_path):
    record(tmp_path / "my_recording")
    blocks = re.findall(r"^```bash\n(.*?)^```", TUTORIAL.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 5
    script = "".join(blocks)
    for at_full_size, here in _INTRINSICS.items():
        assert at_full_size in script
        script = script.replace(at_full_size, here)
    # last, as its digits may be those of an intrinsic; another program may be on the default port
    port = free_endpoint().rpartition(":")[2]
    script = script.replace("hsslam-serve ", f"hsslam-serve --zenoh-port {port} {_QUICKLY} ")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=tmp_path,
        env=os.environ | {"PATH": path},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("0000.png\n0001.png\n")
    assert json.loads((tmp_path / "findings.json").read_text())["faults"] == 0
    assert len(read_tum(tmp_path / "runs/mine/trajectory.txt").stamps_ns) == FRAMES
    for name in ("mesh.ply", "run.mcap", "run.rrd", "map.safetensors", "summary.json"):
        assert (tmp_path / "runs/mine" / name).stat().st_size > 1000
        assert f"\n{name}\n" in done.stdout
