"""A run from a folder with modules of our names that takes no files; other tests run from the checkout."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hsslam_services.bus.bus import free_endpoint
from tests.services.serve_process import SMALL_ROOM

pytestmark = pytest.mark.e2e
_HOSTILE = (
    *("torch.py", "numpy.py", "msgspec.py", "zenoh.py", "numba.py", "hsslam_services.py"),
    *("hsslam_node/__init__.py", "hsslam_proto/__init__.py"),
)


def test_a_working_folder_with_modules_of_our_names_that_takes_no_files(tmp_path: Path):
    here = tmp_path / "here"
    for name in _HOSTILE:
        (here / name).parent.mkdir(parents=True, exist_ok=True)
        (here / name).write_text(f"raise SystemExit('{name} of the working folder')")
    before = sorted(here.rglob("*"))
    _expect_a_run(here, tmp_path / "run", prefix=_read_only(here))
    assert sorted(here.rglob("*")) == before


def test_the_benchmark_starts_its_processes_with_a_safe_path(tmp_path: Path):
    (tmp_path / "torch.py").write_text("raise SystemExit('torch.py of the working folder')")
    code = (
        "from hsslam_bench.runs.session import _python\n"
        "_python('hsslam_node.slam')"  # it imports torch
    )
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr


def _read_only(folder: Path) -> tuple[str, ...]:
    """What to put before a command; root ignores modes, so for root it is a mount."""
    folder.chmod(0o555)
    if os.geteuid() != 0:
        return ()
    if os.system("unshare -m true 2>/dev/null") != 0:
        pytest.skip("this machine does not allow mount namespaces")
    bind = 'mount --bind "$0" "$0" && mount -o remount,ro,bind "$0" && cd "$0" && ! touch x 2>/dev/null'
    return ("unshare", "-m", "sh", "-c", f'{bind} && exec "$@"', str(folder))


def _expect_a_run(here: Path, out: Path, prefix: tuple[str, ...] = ()) -> None:
    """Twelve frames in lockstep by the installed command, all tracked and saved."""
    command = shutil.which("hsslam-serve", path=Path(sys.executable).parent)
    assert command is not None, "expected the package installed: pip install -e ."
    places = ("--out", str(out), "--zenoh-port", free_endpoint().rpartition(":")[2])
    steps = ("--frames", "12", "--pace", "lockstep", "--viewer", "none")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run(
        [*prefix, command, *SMALL_ROOM, *places, *steps],
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert done.returncode == 0, done.stderr
    assert "of the working folder" not in done.stderr
    assert len((out / "trajectory.txt").read_text().splitlines()) >= 12
    assert (out / "mesh.ply").stat().st_size > 0
