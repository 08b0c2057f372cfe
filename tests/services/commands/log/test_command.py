"""`hsslam-log` as a user runs it; what it writes is read by others' readers."""

import os
import pty
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
import rerun_cli
from mcap.reader import make_reader

from hsslam_proto.codec import encode
from hsslam_proto.topics import POSE
from hsslam_services.commands.log.command import main
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.reading.files import log_files
from hsslam_services.log.reading.reader import bus_messages
from tests.services.log.sample_log import PERIOD_NS, START_NS, write_log, write_poses
from tests.services.wire_samples import pose


def test_info_tells_topics_rates_duration_and_the_options_of_the_run(tmp_path, capsys):
    words = "--source tum:desk --seed 7 --no-evaluate --slam.mapper.rays 900 --slam.ba.no-enabled"
    given = parse_command_line(words.split())
    options = msgspec.json.encode(given).decode()
    metadata = {"run_id": "run-1", "version": "0.1", "options": options}
    path = write_log(tmp_path, metadata=metadata)
    assert main(["info", str(path)]) == 0
    printed = capsys.readouterr().out
    shown = " ".join(printed.split())
    assert "finished" in shown and "1.9 s from 2023-11-14 22:13:20 UTC" in shown
    assert f"run run-1 of hsslam-node 0.1: {words}\n" in printed
    assert "hsslam/r/in/frame │ hsslam.Frame.v1 │ 20 │ 10.00 │" in shown
    assert "/viz/mesh │ foxglove.SceneUpdate │ 2 │" in shown


def test_a_torn_log_is_recovered_by_whatever_opens_it(tmp_path, capsys):
    path = write_log(tmp_path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) * 3 // 4])
    assert main(["info", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1 and "recovered" in captured.err
    assert main(["recover", str(path)]) == 0
    assert "finished already" in capsys.readouterr().out
    path.write_bytes(whole[: len(whole) // 2])
    assert main(["recover", str(path)]) == 0
    assert "recovered" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("trim LOG OUT", "of 1.9 s"),
        ("export LOG --only frames", "of 1.9 s"),
        ("recover LOG", "checking"),
    ],
)
def test_on_a_terminal_a_command_shows_that_it_works(tmp_path, command, expected):
    places = {"LOG": str(write_log(tmp_path)), "OUT": str(tmp_path / "short.mcap")}
    words = [places.get(word, word) for word in command.split()]
    ours, theirs = pty.openpty()
    run = [sys.executable, "-m", "hsslam_services.commands.log.command", *words]
    subprocess.run(run, stderr=theirs, check=True, timeout=60)
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    assert expected in shown


def test_trim_copies_what_lies_between(tmp_path, capsys):
    path = write_log(tmp_path, part_bytes=30_000, metadata={"run_id": "x"})
    assert (tmp_path / "run.1.mcap").exists()
    short = tmp_path / "short.mcap"
    assert main(["trim", str(tmp_path), str(short), "--start", "0.5", "--end", "1.2"]) == 0
    with short.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert [record.metadata for record in reader.iter_metadata()] == [{"run_id": "x"}]
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
    times = [time for topic, time, _ in found if topic == "hsslam/r/out/pose"]
    assert times == [START_NS + PERIOD_NS * index for index in range(5, 12)]
    original = []
    for part in tmp_path.glob("run*.mcap"):
        with part.open("rb") as stream:
            original += [
                (c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages()
            ]
    kept = [m for m in original if START_NS + 5 * PERIOD_NS <= m[1] < START_NS + 12 * PERIOD_NS]
    assert sorted(found) == sorted(kept)
    assert path.exists()


def test_an_export_that_has_nothing_to_write_is_bad_input(tmp_path, capsys):
    path = write_poses(tmp_path, 3)
    assert main(["export", str(path), "--only", "mesh", "frames"]) == 2
    told = f"error: --only mesh frames: expected something that {path} has"
    assert capsys.readouterr().err.splitlines()[-1] == told


def test_trim_replaces_no_part_of_the_log(tmp_path, capsys):
    write_log(tmp_path, part_bytes=30_000)
    later, first = tmp_path / "run.1.mcap", tmp_path / "run.mcap"
    before = first.read_bytes()
    assert main(["trim", str(later), str(first)]) == 2  # as of run*.mcap
    assert f"{first}: is a part of a log: expected a new file" in capsys.readouterr().err
    assert first.read_bytes() == before


def test_a_part_that_cannot_be_recovered_does_not_keep_the_others_from_it(tmp_path, capsys):
    write_log(tmp_path, part_bytes=30_000)
    parts = log_files(tmp_path)
    first, last = parts[0], parts[-1]
    first.write_bytes(b"of another program")
    last.write_bytes(last.read_bytes()[:-100])
    assert main(["recover", str(tmp_path)]) == 2
    shown = capsys.readouterr()
    assert f"error: {first}: " in shown.err
    assert f"{last}: was not finished: recovered" in shown.out
    assert is_finished(last)


def test_trim_replaces_no_log_through_a_link(tmp_path, capsys):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_log(tmp_path / name)
    log, link = tmp_path / "b" / "run.mcap", tmp_path / "short.mcap"
    link.symlink_to(log)
    before = log.read_bytes()
    assert main(["trim", str(tmp_path / "a" / "run.mcap"), str(link)]) == 2
    assert f"{link}: is a part of a log: expected a new file" in capsys.readouterr().err
    assert log.read_bytes() == before


def test_trim_keeps_the_order_if_the_clock_was_set_back(tmp_path, capsys):
    path, short = tmp_path / "run.mcap", tmp_path / "short.mcap"
    log = McapLog(path, "r")
    for index in range(20):
        log_ns = START_NS + PERIOD_NS * (index if index < 12 else index - 6)
        log.write(POSE, encode(POSE, pose(index)), log_ns, log_ns, index)
    log.close()
    assert main(["trim", str(path), str(short), "--start", "0"]) == 0
    poses = [one.message() for one in bus_messages([short])]
    assert [one.index for one in poses] == list(range(20))


def test_trim_copies_all_parts_if_the_clock_was_set_back_between_them(tmp_path, capsys):
    for number, name in enumerate(("run.mcap", "run.1.mcap")):
        log = McapLog(tmp_path / name, "r")
        for index in range(10 * number, 10 * number + 10):
            log_ns = START_NS + PERIOD_NS * index - number * 3_600_000_000_000
            log.write(POSE, encode(POSE, pose(index)), log_ns, log_ns, index)
        log.close()
    short = tmp_path / "short.mcap"
    assert main(["trim", str(tmp_path), str(short)]) == 0
    poses = [one.message() for one in bus_messages([short])]
    assert [one.index for one in poses] == list(range(20))


def test_trim_takes_an_end_without_limit(tmp_path, capsys):
    path, short = write_log(tmp_path, count=4), tmp_path / "short.mcap"
    for end in ("inf", "1e300"):
        assert main(["trim", str(path), str(short), "--start", "0.1", "--end", end]) == 0
        with short.open("rb") as stream:
            poses = make_reader(stream).iter_messages("hsslam/r/out/pose")
            assert [m.log_time for _, _, m in poses][-1] == START_NS + 3 * PERIOD_NS


def test_rerun_finds_nothing_wrong_with_the_log(tmp_path):
    path = write_log(tmp_path)
    rerun = Path(rerun_cli.__file__).parent / "rerun"
    done = subprocess.run([rerun, "mcap", "check", path], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("inf x", "inf: expected info, recover, trim, export; did you mean info?"),
        ("info", "info: no log: expected FILE..."),
        ("info none.mcap", "none.mcap: No such file or directory: expected a log"),
        ("trim LOG out.mcap --start 3 --end 2", "--end 2: expected seconds, more than --start"),
        ("trim LOG .", ".: is a folder: expected a file, such as short.mcap"),
        ("trim LOG /out.mcap --start 1e300", "no message from 1e+300 to its end"),
        ("trim LOG LOG", "is the log itself: expected another file"),
        ("trim LOG /out.mcap --start 99", "no message from 99 to its end"),
        ("trim LOG /none/out.mcap", "/none/out.mcap: No such file or directory"),
        ("trim LOG", "trim: OUT is missing"),
        ("export LOG --only video", "--only"),
        ("export LOG --only", "--only: missing value: expected --only "),
        (
            "export LOG --format kiti",
            "--format kiti: expected tum or kitti or euroc or csv; did you",
        ),
        ("export LOG --out /proc/x", "/proc/x: No such file or directory: expected a folder"),
        ("info LOG --al", "--al: unknown option"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(tmp_path, capsys, line, expected):
    path = write_log(tmp_path, count=2)
    before = path.read_bytes()
    assert main(line.replace("LOG", str(path)).split()) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and told.count("\n") == 1
    assert expected in told
    assert path.read_bytes() == before
