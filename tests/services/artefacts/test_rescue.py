"""A rescue in the process that calls it: what it says of an arena that holds nothing."""

from pathlib import Path

from hsslam_services.artefacts.rescue import rescue
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.summary import read_summary


def test_nothing_is_called_saved_if_there_is_nothing(run_info: RunInfo, tmp_path: Path):
    (tmp_path / "run.json").unlink()
    said: list[str] = []
    assert rescue(Path(run_info.arena_dir), tmp_path, said.append) == {}
    assert said == [f"{name}: nothing to save" for name in ("trajectories", "map", "mesh")]
    assert read_summary(tmp_path)["rescued"] == []
    assert not list(tmp_path.glob("*.txt"))
    assert RunInfo.read(tmp_path) == run_info
