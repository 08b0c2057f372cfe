"""A log in parts: each opens alone, together they are the log, and the oldest may go."""

import os
import re
import threading

from mcap.reader import make_reader
from rich.table import Table
from rich.text import Text

from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.run_messages import Event
from hsslam_services.commands.log.info import log_info
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.parts import parts
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import bus_messages
from hsslam_services.run.source_table import SERVICE_SOURCES
from tests.services.log.sample_log import write_log
from tests.services.wire_samples import pose

_EVENT = Event(process="mapper", level="info", text="a line", stamp_ns=0)


def test_each_part_opens_alone_and_together_they_are_the_log(tmp_path):
    log = PartedLog(tmp_path, "r", LogSettings(part_bytes=40_000, metadata={"run_id": "x"}))
    for index in range(2000):
        log.write(topics.POSE, encode(topics.POSE, pose(index)), 1000 + index, 1000 + index, index)
        log._part._writer.flush()
    assert log.close() == 0
    assert log.counts == {"out/pose": 2000}
    files = log_parts(tmp_path, print)
    assert [file.name for file in files[:3]] == ["run.mcap", "run.1.mcap", "run.2.mcap"]
    found = []
    for file in files:
        assert file.stat().st_size < 80_000
        with file.open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert [record.metadata for record in reader.iter_metadata()] == [{"run_id": "x"}]
            part = [(s.name if s else "", m.sequence) for s, _, m in reader.iter_messages()]
        assert {name for name, _ in part} == {"hsslam.Pose.v1"}
        found += [sequence for _, sequence in part]
    assert found == list(range(2000))
    assert [logged.message().index for logged in bus_messages(files)] == list(range(2000))


def test_a_slow_disk_delays_no_message_when_a_part_is_full(tmp_path, monkeypatch):
    is_written, in_time = threading.Event(), []
    to_disk = os.fdatasync

    def slowly(fd: int) -> None:
        in_time.append(is_written.wait(20))
        to_disk(fd)

    monkeypatch.setattr(os, "fdatasync", slowly)
    log = PartedLog(tmp_path, "r", LogSettings(part_bytes=40_000))
    written = 0
    while log.path.name == "run.mcap":
        log.write(topics.POSE, encode(topics.POSE, pose(written)), written, written, written)
        log._part._writer.flush()
        written += 1
    assert written > 1 and not is_written.is_set()
    is_written.set()
    assert log.close() == 0 and all(in_time)
    files = log_parts(tmp_path, print)
    assert len(files) == 2 and all(map(is_finished, files))
    assert [logged.message().index for logged in bus_messages(files)] == list(range(written))


def test_a_clock_that_is_set_during_the_log_costs_no_message_and_no_order(tmp_path):
    log = PartedLog(tmp_path, "r", LogSettings(part_bytes=40_000))
    for index in range(2000):
        now_ns = 10**18 + index - (10**15 if index > 150 else 0) + (10**17 if index > 1500 else 0)
        log.write(topics.POSE, encode(topics.POSE, pose(index)), now_ns, now_ns, index)
        log.write(topics.EVENT, encode(topics.EVENT, _EVENT), now_ns, now_ns, index)
        if index % 100 == 0:
            log._part._writer.flush()
    log.close()
    files = log_parts(tmp_path, print)
    poses = bus_messages(files, {topics.POSE.name})
    assert [logged.message().index for logged in poses] == list(range(2000))
    both = [logged.topic for logged in bus_messages(files)]
    assert both == [topics.POSE, topics.EVENT] * 2000
    poses = bus_messages(files, {topics.POSE.name, topics.EVENT.name})
    found = [logged.message().index for logged in poses if logged.topic is topics.POSE]
    assert found == list(range(2000))


def test_a_log_that_keeps_little_loses_its_oldest_parts_only(tmp_path):
    log = PartedLog(tmp_path, "r", LogSettings(keep_bytes=100_000))
    for index in range(2000):
        log.write(topics.POSE, encode(topics.POSE, pose(index)), 1000 + index, 1000 + index, index)
        if index % 50 == 0:
            log._part._flushed_s = 0.0
            log.tick()
            assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 100_000
    log.close()
    assert log.counts == {"out/pose": 2000}
    assert log.removed[:2] == ["run.mcap", "run.1.mcap"]
    found = [logged.message().index for logged in bus_messages(log_parts(tmp_path, print))]
    assert found == list(range(found[0], 2000))
    assert len(found) > 300
    row = next(row for row in SERVICE_SOURCES if row.kind == "mcap")
    assert row.looks_like(tmp_path)
    line, table = log_info(log_parts(tmp_path, print))
    assert isinstance(line, Text) and isinstance(table, Table)
    parts = len(list(tmp_path.iterdir()))
    assert re.search(rf"run\.\d+\.mcap to run\.\d+\.mcap, {parts} parts: finished", line.plain)
    assert f"{len(found)} messages" in line.plain
    assert list(table.columns[2].cells) == [str(len(found))]


def test_a_part_that_is_missing_is_told(tmp_path):
    write_log(tmp_path, part_bytes=1 << 16)
    first, gone, *later = parts(tmp_path)
    assert later
    gone.unlink()
    told: list[str] = []
    assert log_parts(tmp_path, told.append) == [first, *later]
    text = "the part before it is missing, after run.mcap: the log has a gap"
    assert told == [f"{later[0]}: {text}"]
    first.unlink()  # as --log-keep removes the oldest
    assert log_parts(tmp_path, told.append) == later and len(told) == 1
