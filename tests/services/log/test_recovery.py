"""Logs that are cut off, damaged, foreign or being written: what is whole comes back, nothing is lost."""

import fcntl
import os
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_services.log import recovery
from hsslam_services.log.channel_copies import CHANNELS, LIBRARY
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.recovery import recover

_CHUNKS, _PER_CHUNK = 30, 20
_TOPICS = (topics.STEP, topics.POSE, topics.EVENT)
_MOST_DAMAGED_BYTES = 300


@pytest.fixture(scope="module")
def sample(tmp_path_factory):
    """An unfinished log and, for each chunk, where it lies and the sequences of its messages."""
    path = tmp_path_factory.mktemp("sample") / "run.mcap"
    log = _write(path, _CHUNKS)
    log.close()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    places = [
        (chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length)
        for chunk in summary.chunk_indexes
    ]
    assert len(places) == _CHUNKS
    return path.read_bytes(), places


_DAMAGE = st.lists(
    st.tuples(
        st.floats(0, 1, exclude_max=True),
        st.sampled_from(["overwrite", "zero", "cut", "insert"]),
        st.binary(min_size=1, max_size=_MOST_DAMAGED_BYTES),
    ),
    min_size=1,
    max_size=3,
)


@settings(max_examples=60)
@given(_DAMAGE, st.floats(0.2, 1))
def test_every_chunk_that_is_whole_comes_back(sample, tmp_path_factory, damage, left):
    content, places = sample
    end = max(int(left * len(content)), len(content) - 1 if left > 0.95 else 0)
    whole = [place for place in places if place[1] <= end]
    torn = bytearray(content[:end])
    # from the end, so that what is cut out moves nothing that is still to be damaged
    for share, kind, data in sorted(damage, reverse=True):
        at = 8 + int(share * (end - 8))
        until = min(at + len(data), end)
        whole = [(a, b) for a, b in whole if b <= at or a >= (at if kind == "insert" else until)]
        match kind:
            case "overwrite":
                torn[at:until] = data[: until - at]
            case "zero":
                torn[at:until] = bytes(until - at)
            case "cut":
                del torn[at:until]
            case "insert":
                torn[at:at] = data
    path = tmp_path_factory.mktemp("torn") / "run.mcap"
    path.write_bytes(torn)
    recovered = recover(path)
    found = _sequences(path, all_defined=places[0] in whole)
    expected = {places.index(place) for place in whole}
    lost = {k for k in expected if not found >= _of_chunk(k)}
    assert lost == set()
    assert is_finished(path)
    assert sum(recovered.counts.values()) == len(found)
    if recovered.original is not None:
        assert recovered.original.read_bytes() == torn
    assert recover(path).was_whole


def test_one_damaged_word_costs_one_chunk_and_the_original_stays(tmp_path):
    path = tmp_path / "run.mcap"
    log = McapLog(path, "robot", metadata={"run_id": "x"})
    for index in range(2000):
        log.write(topics.STEP, os.urandom(1000), index + 1, index + 1, index)
        if index % 20 == 19:
            log._flushed_s = 0.0
            log.tick()
    log._writer.add_attachment(1, 1, "note.txt", "text/plain", b"a note")
    log._file.release()  # killed: no end
    log._file.wait_until_closed()
    content = bytearray(path.read_bytes())
    content[len(content) // 4 : len(content) // 4 + 4] = bytes(4)
    path.write_bytes(content)
    told: list[str] = []
    log_parts(path, told.append)
    assert "recovered 1980 messages, skipped 1 damaged place" in told[0]
    assert (tmp_path / "run.damaged.mcap").read_bytes() == content
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert len(list(reader.iter_messages())) == 1980
        assert [record.metadata for record in reader.iter_metadata()] == [{"run_id": "x"}]
        attachments = [record for record in reader.iter_attachments() if record.name != CHANNELS]
    assert [(record.name, record.data) for record in attachments] == [("note.txt", b"a note")]


def _damaged_log(path: Path) -> bytes:
    log = McapLog(path, "robot")
    for index in range(400):
        log.write(topics.STEP, os.urandom(1000), index + 1, index + 1, index)
        if index % 20 == 19:
            log._flushed_s = 0.0
            log.tick()
    log._file.release()  # killed: no end
    log._file.wait_until_closed()
    content = bytearray(path.read_bytes())
    content[len(content) // 4 : len(content) // 4 + 4] = bytes(4)
    path.write_bytes(content)
    return bytes(content)


def test_a_log_is_recovered_through_a_link(tmp_path):
    path, link = tmp_path / "run" / "run.mcap", tmp_path / "desk.mcap"
    path.parent.mkdir()
    content = _damaged_log(path)
    link.symlink_to(path)
    assert not recover(link).was_whole
    assert link.is_symlink()
    assert (path.parent / "run.damaged.mcap").read_bytes() == content
    assert recover(path).was_whole


def test_an_interrupted_recovery_leaves_only_the_log(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    content = _damaged_log(path)

    def interrupted(stream, survey, out):
        out.write(b"a part")
        raise KeyboardInterrupt

    monkeypatch.setattr(recovery, "_copy", interrupted)
    with pytest.raises(KeyboardInterrupt):
        recover(path)
    assert [one.name for one in tmp_path.iterdir()] == ["run.mcap"]
    assert path.read_bytes() == content


def test_a_file_that_only_lacks_its_end_gets_one_in_place(sample, tmp_path):
    content, places = sample
    path = tmp_path / "run.mcap"
    path.write_bytes(content[: places[20][0] + 100])
    inode = path.stat().st_ino
    recovered = recover(path)
    assert _sequences(path) == {k for chunk in range(20) for k in _of_chunk(chunk)}
    assert (recovered.original, path.stat().st_ino) == (None, inode)
    assert [found.name for found in tmp_path.iterdir()] == ["run.mcap"]
    assert path.read_bytes().startswith(content[: places[20][0]])


def test_a_finished_log_that_is_damaged_is_recovered_when_asked(sample, tmp_path):
    content, places = sample
    path = tmp_path / "run.mcap"
    torn = bytearray(content)
    torn[places[0][0] + 60] ^= 255  # the chunk that defines the channels
    path.write_bytes(torn)
    recovered = recover(path)
    assert (recovered.gaps, recovered.original) == (1, tmp_path / "run.damaged.mcap")
    assert _sequences(path) == {k for chunk in range(1, _CHUNKS) for k in _of_chunk(chunk)}


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"\x89MCAP0\r\n"])
def test_a_file_without_a_record_becomes_an_empty_log(tmp_path, content):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    assert recover(path).counts == {}
    assert _sequences(path) == set()


@pytest.mark.parametrize("content", [b"no log at all", bytes(100), b"\x89MCAP0\r\n" + b"?" * 100])
def test_what_is_no_log_is_not_touched(tmp_path, content):
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(UserError, match="no log of this program"):
        recover(path)
    assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


def test_an_unfinished_file_of_another_program_is_not_touched(tmp_path):
    path = tmp_path / "theirs.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="libmcap")
        channel = writer.register_channel("/camera", "cdr", 0)
        writer.add_message(channel, 1, b"x" * 100, 1)
        writer.flush()
        before = path.read_bytes()
        writer.finish()
    assert recover(path).line() == "was finished already"
    path.write_bytes(before)
    with pytest.raises(UserError, match="unfinished, and no log of this program"):
        log_parts(path, print)
    assert path.read_bytes() == before


def test_a_log_that_another_process_writes_is_not_touched(sample, tmp_path):
    content, _ = sample
    path = tmp_path / "run.mcap"
    path.write_bytes(content[:-100])
    with path.open("rb") as writer:
        fcntl.flock(writer, fcntl.LOCK_EX)
        with pytest.raises(UserError, match="still writing"):
            recover(path)
    assert path.read_bytes() == content[:-100]


def test_a_log_that_two_programs_make_readable_is_recovered_once(sample, tmp_path):
    """The second waits for the lock of the first, which has put a whole copy in its place by then."""
    content, places = sample
    path = tmp_path / "run.mcap"
    path.write_bytes(content[: places[3][0]] + bytes(100) + content[places[3][0] + 100 : -200])
    held = path.open("rb")
    fcntl.flock(held.fileno(), fcntl.LOCK_EX)
    whole = tmp_path / "whole"
    whole.write_bytes(content)

    def end_of_the_first() -> None:
        path.rename(tmp_path / "run.damaged.mcap")
        whole.rename(path)
        held.close()

    first = threading.Timer(0.3, end_of_the_first)
    first.start()
    recovered = recover(path)
    first.join()
    assert recovered.was_whole and path.read_bytes() == content
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.damaged.mcap", "run.mcap"]


def _write(path, chunks):
    log = McapLog(path, "r", metadata={"run_id": "x"})
    noise = np.random.default_rng(0)
    for index in range(chunks * _PER_CHUNK):
        log.write(_TOPICS[index % 3], noise.bytes(200), index + 1, index + 1, index)
        if index % _PER_CHUNK == _PER_CHUNK - 1:
            log._flushed_s = 0.0
            if index % (5 * _PER_CHUNK) == _PER_CHUNK - 1:
                log._copies._written_s = float("-inf")  # as 10 s later
            log.tick()
    return log


def _of_chunk(k):
    return set(range(k * _PER_CHUNK, (k + 1) * _PER_CHUNK))


def _sequences(path, all_defined=True):
    """Sequences of all messages, each on the channel that it was written to.

    Without `all_defined`, the chunk that defines the channels is damaged, and each copy of the definitions
    may be: recovery then names a channel after its number.
    """
    with path.open("rb") as stream:
        found = list(make_reader(stream, validate_crcs=True).iter_messages())
    sequences = {message.sequence for _, _, message in found}
    assert len(sequences) == len(found)
    for schema, channel, message in found:
        topic = _TOPICS[message.sequence % 3]
        if not all_defined and channel.topic == f"lost/{channel.id}":
            continue
        assert schema is not None
        assert (channel.topic, schema.name) == (topic.key("r"), topic.schema)
    return sequences


def test_messages_without_chunks_are_no_damage(tmp_path):
    """MCAP allows them; only chunks have checksums."""
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=False)
        writer.start(library=LIBRARY)
        channel = writer.register_channel("hsslam/r/out/pose", "msgpack", 0)
        for k in range(20):
            writer.add_message(channel, k, b"pose", k)
        writer.finish()
    content = path.read_bytes()
    assert recover(path).was_whole
    assert path.read_bytes() == content and list(tmp_path.iterdir()) == [path]
