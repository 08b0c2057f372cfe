"""The example of a camera plugin, as pip installs it: in help and errors, opened by the doctor, and run."""

import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from hsslam_node.geometry.trajectory import read_tum
from hsslam_services.bus.bus import free_endpoint
from tests.repository import ROOT
from tests.services.run.installed_package import install
from tests.services.serve_process import QUICK
from tests.small_room import pose_error, room_frames, room_poses

_EXAMPLE = ROOT / "examples/camera_plugin"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of packages with the example, and with another that cannot be imported."""
    project = tomllib.loads((_EXAMPLE / "pyproject.toml").read_text())["project"]
    folder = tmp_path_factory.mktemp("site")
    shutil.copytree(_EXAMPLE / "hsslam_npz", folder / "hsslam_npz")
    install(folder, project["name"], {}, project["entry-points"]["hsslam.sources"])
    install(folder, "hsslam-broken", {}, {"broken": "hsslam_broken:ROW"})
    return folder


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames of the small room, as the example reads them."""
    folder, frames = tmp_path_factory.mktemp("recording"), room_frames()[:6]
    camera = frames[0].camera
    told = {
        name: getattr(camera, name) for name in ("width_px", "height_px", "fx", "fy", "cx", "cy")
    }
    told |= {"rate_hz": 30.0, "depth_units_per_m": frames[0].depth_units_per_m}
    (folder / "camera.json").write_text(json.dumps(told))
    for k, frame in enumerate(frames):
        arrays = {"stamp_ns": frame.stamp_ns, "color": frame.color, "depth": frame.depth_raw}
        np.savez(folder / f"{k:06d}.npz", **arrays)
    return folder


def _run(site: Path, module: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    environment = os.environ | {"PYTHONPATH": str(site)}
    command = [sys.executable, "-m", f"hsslam_services.commands.{module}", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)


def test_help_lists_the_plugin_and_says_what_is_wrong_with_another(site):
    lines = _run(site, "serve", "--help").stdout.splitlines()
    (npz,) = (line for line in lines if "npz:FOLDER" in line)
    assert npz.endswith("frames saved with NumPy")
    (broken,) = (line for line in lines if "broken:" in line)
    assert "package hsslam-broken: ModuleNotFoundError: No module named 'hsslam_broken'" in broken


def test_the_doctor_opens_its_recording(site, recording):
    (recording / "000006.npz").write_bytes(b"")
    done = _run(site, "doctor", f"npz:{recording}")
    assert done.returncode in (0, 1), done.stderr  # it may find the recording short
    assert "160 x 120" in done.stdout or "160x120" in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.e2e
def test_the_service_tracks_its_recording(site, recording, tmp_path):
    out, port = tmp_path / "run", free_endpoint().rpartition(":")[2]
    options = ("--pace", "lockstep", "--viewer", "none", "--zenoh-port", port, *QUICK)
    done = _run(site, "serve", "--source", f"npz:{recording}", "--out", str(out), *options)
    assert done.returncode == 0, done.stderr
    found = read_tum(out / "trajectory.txt")
    assert found.stamps_ns.tolist() == [frame.stamp_ns for frame in room_frames()[:6]]
    for T, true in zip(found.T_world_cam, room_poses(), strict=False):
        assert pose_error(T, true)[0] < 0.01


def test_bad_input_is_one_line(site, tmp_path):
    done = _run(site, "doctor", f"npz:{tmp_path}")
    assert done.returncode == 2
    assert done.stderr == f"error: source npz:{tmp_path}: no .npz: expected a folder of frames\n"
