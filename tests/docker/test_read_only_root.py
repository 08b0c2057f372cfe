"""A run with the mounts of compose.yaml: the root is read-only but for /dev/shm and what is mounted over."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_node.kernels.cache_folder import cache_root

_IN_PRIVATE = ("unshare", "--mount", "--map-root-user")
_OPTIONS = (
    "--source synth:room --synth.width-px 160 --synth.height-px 120 --frames 3 --pace lockstep"
    " --slam.mapper.first-iterations 10 --slam.mapper.last-iterations 0 --slam.mapper.rays 256"
    " --slam.mesher.final-voxel-m 0.08 --no-evaluate"
)


def test_a_run_needs_no_more_than_the_volumes_and_tmp(tmp_path):
    if not _may_mount(tmp_path):
        pytest.skip("this machine lets its user mount nothing")
    writable = [tmp_path, cache_root()]
    mounts = [f"mount --bind {folder} {folder}" for folder in map(str, writable)]
    command = [sys.executable, "-P", "-m", "hsslam_services.commands.serve", *_OPTIONS.split()]
    command += ["--viewer", "none", "--out", str(tmp_path / "run")]
    script = " && ".join(
        [*mounts, "mount -o remount,bind,ro /", "! touch /read-only-test", shlex.join(command)]
    )
    result = subprocess.run(
        [*_IN_PRIVATE, "sh", "-c", script],
        env=os.environ | {"TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    for name in ("trajectory.txt", "mesh.ply", "map.safetensors", "run.mcap", "run.rrd"):
        assert (tmp_path / "run" / name).stat().st_size > 0


def _may_mount(folder: Path) -> bool:
    if shutil.which("unshare") is None:
        return False
    mount = f"mount --bind {folder} {folder} && mount -o remount,bind,ro /"
    return subprocess.run([*_IN_PRIVATE, "sh", "-c", mount], capture_output=True).returncode == 0
