"""The power is cut right after a run has ended: what the run reported as saved is on the disk, whole."""

import contextlib

import pytest

from hsslam_services.log.reading.files import log_parts
from tests.services.serve_process import SMALL_ROOM, ServeProcess

pytestmark = pytest.mark.e2e


def test_a_power_cut_after_a_run_costs_none_of_its_results(disk):
    out = disk.folder / "run"
    with contextlib.closing(ServeProcess(out, *SMALL_ROOM, "--frames", "30")) as run:
        assert run.finish() == 0, run.stderr
        files = [path for path in out.iterdir() if path.is_file()]
        after = disk.cut() / "run"
        assert {path.name for path in files} >= {"trajectory.txt", "map.safetensors", "mesh.ply"}
        for path in files:
            assert (after / path.name).read_bytes() == path.read_bytes(), path.name
    told: list[str] = []
    assert len(list(log_parts(after, told.append))) == 1 and not told
