"""Results on disk."""

import pytest

from hsslam_bench.results.report import machine
from hsslam_bench.tables.options import TableOptions, with_overrides
from hsslam_bench.tables.plan import Job, RunResult, folder_name
from hsslam_bench.tables.result_file import ResultFile
from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS
from hsslam_node.sources.options.source import SourceOptions


def _job(**changes) -> Job:
    fields = {
        "table": "ablation",
        "row": "A",
        "sequence": "house",
        "source": "replica:/data/house",
        "seed": 0,
        "protocol": "preset paper; all frames",
        "config": PRESETS["paper"],
        "frames": SourceOptions(),
    }
    return Job(**(fields | changes))


def _result(job: Job, commit: str = "abc", **changes) -> RunResult:
    fields = {name: getattr(job, name) for name in ("key", "row", "sequence", "seed", "protocol")}
    return RunResult(**(fields | {"commit": commit} | changes))


def test_only_the_same_configuration_and_commit_counts_as_done(tmp_path):
    file, job = ResultFile(tmp_path / "a/out.json", "ablation"), _job()
    file.add(_result(job, values={"ate_cm": 1.5}), machine())
    again = ResultFile(tmp_path / "a/out.json", "ablation")
    found = again.done(job, "abc")
    assert found is not None and found.values == {"ate_cm": 1.5}
    assert again.done(_job(source="replica:/elsewhere/house"), "abc") is not None
    assert again.done(job, "def") is None
    assert again.newest(_job(config=PRESETS["realtime"])) is not None
    assert again.newest(_job(protocol="preset paper; 5 frames")) is None
    others = (
        {"seed": 1},
        {"row": "B"},
        {"frames": SourceOptions(frames=5)},
        {"config": with_overrides(PRESETS["paper"], {"mapper.rays": 5})},
    )
    assert all(again.done(_job(**change), "abc") is None for change in others)


def test_runs_of_other_options_share_no_folder_and_no_figures(tmp_path):
    job = _job()
    assert folder_name(_result(job)) == folder_name(job)
    others = [
        _job(frames=SourceOptions(noise="kinect")),
        _job(frames=SourceOptions(frames=5)),
        _job(config=PRESETS["realtime"]),
        _job(device="cuda", protocol=TableOptions(device="cuda").protocol),
    ]
    assert len({folder_name(each) for each in (job, *others)}) == len(others) + 1
    of_cpu = _job(protocol=TableOptions().protocol)
    assert not _result(of_cpu).answers(others[-1])


def test_what_failed_or_was_made_from_changed_files_is_run_again(tmp_path):
    file, job = ResultFile(tmp_path / "out.json", "ablation"), _job()
    file.add(_result(job, error="killed"), machine())
    assert file.done(job, "abc") is None
    file.add(_result(job), machine())
    assert file.done(job, "abc") is not None
    assert len(file.runs) == 1
    file.add(_result(job, "abc+"), machine())
    assert file.done(job, "abc+") is None
    file.add(_result(job, ""), machine())  # outside of a checkout
    assert file.done(job, "") is None


def test_two_that_fill_one_file_lose_nothing(tmp_path):
    first, second = (ResultFile(tmp_path / "out.json", "ablation") for _ in range(2))
    first.add(_result(_job(row="A")), machine())
    second.add(_result(_job(row="B")), machine())
    first.add(_result(_job(row="C")), machine())
    assert [result.row for result in second.runs] == ["A", "B", "C"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"table": "tum"}', "holds tum, version 1: expected a result of hsslam-bench ablation"),
        ('{"table": "ablation", "version": 9}', "version 9"),
        ('{"table": ', "expected a result of hsslam-bench ablation"),
    ],
)
def test_a_file_of_something_else_is_told(tmp_path, content, message):
    path = tmp_path / "out.json"
    path.write_text(content)
    with pytest.raises(UserError, match=message):
        ResultFile(path, "ablation")
