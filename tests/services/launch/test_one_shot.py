"""The error of a process that should end by itself; alone because others test it in whole runs."""

import subprocess
from pathlib import Path

import pytest

from hsslam_services.launch.one_shot import run_one_shot


@pytest.mark.parametrize(
    ("end", "error"),
    [
        ("kill -9 $$", "mesh_saver was killed by SIGKILL"),  # as by the kernel, for lack of memory
        ("exit 1", "mesh_saver failed; see {folder}/logs/mesh_saver.log"),
        ("exit 0", ""),
    ],
)
def test_a_saver_that_is_killed_is_told_apart(tmp_path: Path, end: str, error: str):
    said = run_one_shot(
        "hsslam_services.processes.mesh_saver",
        tmp_path,
        lambda: None,
        lambda: False,
        timeout_s=60.0,
        spawn=lambda module, run_dir: subprocess.Popen(["sh", "-c", end]),
    )
    assert said == error.format(folder=tmp_path)
