"""Logs and sequences below a folder are found by what the table of sources says of their names."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from mcap.writer import Writer

from hsslam_batch.plan.find_logs import find_logs, with_frames
from hsslam_batch.plan.listing import list_folder
from hsslam_bench.batch.small_log import write_small_log
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions


def _found(root: Path, without: Path = Path("/nowhere")):
    return find_logs(list_folder(root, str(without)))


@pytest.fixture
def recordings(tmp_path: Path, tum_folder: Path, replica_folder: Path) -> Path:
    """A folder with logs and sequences at several depths, and with other things."""
    root = tmp_path / "recordings"
    log = write_small_log(root / "day1" / "walk", count=2)
    (log.parent / "mesh.ply").write_text("ply")
    (log.parent / "run.1.mcap").write_bytes(log.read_bytes())
    shutil.copy(log, root / "loose.mcap")
    shutil.copytree(log.parent, root / ".hidden")
    shutil.copytree(log.parent, root / "batch" / "runs" / "0")
    shutil.copytree(tum_folder, root / "day2" / "desk")
    shutil.copytree(replica_folder, root / "day2" / "room")
    (root / "notes.txt").write_text("no log")
    (root / "runner.mcap.txt").write_text("no log")
    return root


def test_logs_and_sequences_of_all_kinds_are_found_once(recordings: Path):
    found = _found(recordings, without=recordings / "batch")
    assert [(log.index, log.name, log.kind) for log in found] == [
        (0, "day1/walk", "mcap"),
        (1, "day2/desk", "tum"),
        (2, "day2/room", "replica"),
        (3, "loose.mcap", "mcap"),
    ]
    assert found[1].source == f"tum:{recordings}/day2/desk"
    assert len({log.id for log in found}) == 4
    parts = [path.stat().st_size for path in (recordings / "day1/walk").glob("*.mcap")]
    assert found[0].nbytes == sum(parts)  # the mesh beside them is none of it


def test_bags_and_scenes_are_found(tmp_path: Path):
    """By their names alone."""
    for name in (
        *("drive.bag", "lap/metadata.yaml", "lap/lap_0.db3", "old/old_0.db3"),
        *("scans/scene0.sens", "kitchen/frame-000000.color.png", "kitchen/frame-000000.depth.png"),
    ):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert [(log.name, log.kind) for log in _found(tmp_path)] == [
        ("drive.bag", "bag"),
        ("kitchen", "7scenes"),
        ("lap", "bag"),
        ("old/old_0.db3", "bag"),
        ("scans/scene0.sens", "scannet"),
    ]


def test_the_original_of_a_recovered_log_is_no_log(recordings: Path, capsys):
    loose = recordings / "loose.mcap"
    for damaged in ("loose.damaged.mcap", "loose.damaged-2.mcap", "other.damaged.mcap"):
        shutil.copy(loose, recordings / damaged)
    names = [log.name for log in _found(recordings, without=recordings / "batch")]
    assert names == ["day1/walk", "day2/desk", "day2/room", "loose.mcap", "other.damaged.mcap"]
    assert capsys.readouterr().err.splitlines() == [
        f"warning: {recordings / damaged}: left out: the original of loose.mcap"
        for damaged in ("loose.damaged-2.mcap", "loose.damaged.mcap")
    ]


def test_logs_in_a_run_folder_are_left_out_with_a_warning(recordings: Path, capsys):
    """But for those of an earlier run, which the service keeps there."""
    walk = recordings / "day1" / "walk"
    shutil.copytree(walk, walk / "earlier")
    assert [log.name for log in _found(recordings / "day1")] == ["walk"]
    assert capsys.readouterr().err == ""
    shutil.copy(recordings / "loose.mcap", walk / "desk.mcap")
    shutil.copytree(recordings / "day2" / "desk", walk / "more" / "desk")
    assert [log.name for log in _found(recordings / "day1")] == ["walk"]
    assert capsys.readouterr().err == (
        f"warning: {walk}: left out walk/desk.mcap and 1 more: the folder is one log, as it has a run.mcap: "
        "expected each run in a folder of its own\n"
    )


def test_a_log_alone_and_a_folder_that_is_a_log(recordings: Path):
    (alone,) = _found(recordings / "loose.mcap")
    assert (alone.name, alone.place) == ("loose.mcap", str(recordings / "loose.mcap"))
    (folder,) = _found(recordings / "day2" / "desk")
    assert (folder.name, folder.place) == ("desk", str(recordings / "day2/desk"))


def test_the_id_follows_name_and_content(recordings: Path):
    before = {log.name: log.id for log in _found(recordings)}
    assert before == {log.name: log.id for log in _found(recordings)}
    log = recordings / "loose.mcap"
    log.write_bytes(log.read_bytes() + b"0")
    shutil.move(recordings / "day2", recordings / "day3")
    after = {log.name: log.id for log in _found(recordings)}
    assert after["day1/walk"] == before["day1/walk"]
    assert after["loose.mcap"] != before["loose.mcap"]
    assert after["day3/desk"] != before["day2/desk"]


def test_a_file_that_changes_changes_the_id_whatever_the_others_are(recordings: Path):
    """As many bytes as before, and older than another file of the log."""
    folder = recordings / "day2" / "desk"
    file = folder / "rgb.txt"
    (before,) = _found(folder)
    os.utime(file, ns=(1, 1))
    (after,) = _found(folder)
    assert before.nbytes == after.nbytes and before.id != after.id


def test_frames_are_those_that_the_options_select(recordings: Path):
    (recordings / "bad.mcap").write_bytes(b"no log")
    with (recordings / "foreign.mcap").open("wb") as stream:  # its index does not name its channels
        writer = Writer(stream, repeat_channels=False)
        writer.start()
        channel = writer.register_channel("robot/in/frame", "", 0)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()
    found = with_frames(_found(recordings, recordings / "batch"), SourceOptions(stride=2))
    frames = {log.name: log.frames for log in found}
    assert frames == {
        "bad.mcap": 0,
        "foreign.mcap": 0,
        "day1/walk": 2,  # of two parts of two frames each
        "day2/desk": 3,
        "day2/room": 2,
        "loose.mcap": 1,
    }


def test_files_named_like_runs_are_logs_of_their_own(tmp_path: Path):
    log = write_small_log(tmp_path / "elsewhere", count=1)
    for name in ("run_monday.mcap", "run_tuesday.mcap"):
        (tmp_path / "week").mkdir(exist_ok=True)
        shutil.copy(log, tmp_path / "week" / name)
    names = [log.name for log in _found(tmp_path / "week")]
    assert names == ["run_monday.mcap", "run_tuesday.mcap"]


def test_the_results_of_another_batch_are_no_recordings(recordings: Path, capsys):
    other = recordings / "batch"
    for name in ("batch.json", "manifest.parquet"):
        (other / name).touch()
    assert [log.name for log in _found(recordings)] == [
        log.name for log in _found(recordings, without=other)
    ]
    assert f"warning: {other}: left out: the folder of a batch" in capsys.readouterr().err


def test_what_this_user_may_not_see_is_left_out_with_a_warning(recordings: Path, capsys):
    # all modules and codecs are loaded first: the other user may not read them
    whole = [log.name for log in with_frames(_found(recordings), SourceOptions())]
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder, "recordings")
        shutil.copytree(recordings, root)
        for path, mode in ((Path(folder), 0o755), (root / "day1", 0), (root / "loose.mcap", 0)):
            path.chmod(mode)
        own = os.geteuid()
        if own == 0:  # root may see everything
            os.seteuid(54321)
        try:
            found = list(with_frames(_found(root), SourceOptions()))
        finally:
            os.seteuid(own)
        (root / "day1").chmod(0o700)
    assert [log.name for log in found] == [name for name in whole if name[:4] != "day1"]
    assert [log.frames for log in found if log.name == "loose.mcap"] == [0]
    assert f"warning: {root / 'day1'}: left out: Permission denied" in capsys.readouterr().err


def test_a_folder_with_a_description_is_no_bag(recordings: Path):
    whole = [log.name for log in _found(recordings)]
    (recordings / "day2" / "metadata.yaml").write_text("a: data set")
    assert [log.name for log in _found(recordings)] == whole


def test_nothing_to_find_is_one_line(tmp_path: Path):
    with pytest.raises(UserError, match="no logs below: expected files or folders of tum, replica"):
        _found(tmp_path)
    with pytest.raises(UserError, match="nowhere: No such file"):
        _found(tmp_path / "nowhere")
