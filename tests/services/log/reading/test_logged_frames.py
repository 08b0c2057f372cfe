"""Readings of a log that begin late: what they give, and that they read little of what comes before."""

import msgspec
import pytest

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.frame_order import new_publisher
from hsslam_services.camera.open_source import open_any_source
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.logged_frames import LoggedFrames
from tests.services.wire_samples import frame


def _write(folder, sent, robots=("r",), part_bytes=None) -> None:
    """A log of these frames, three in a chunk, of the robots in turn."""
    log = PartedLog(folder, "r", LogSettings(part_bytes=part_bytes))
    for sequence, message in enumerate(sent):
        log._part._robot = robots[sequence % len(robots)]
        payload = encode(topics.FRAME, message)
        log.write(topics.FRAME, payload, message.stamp_ns, message.stamp_ns, sequence)
        if sequence % 3 == 2:
            log._part._writer.flush()
    log.close()


@pytest.mark.parametrize(("robots", "part_bytes"), [("r", None), ("r", 20_000), ("rs", 20_000)])
def test_the_frames_from_any_of_them_on_are_those_of_the_whole_log(tmp_path, robots, part_bytes):
    first, second = new_publisher(), new_publisher()
    numbers = [
        *((first, k) for k in (*range(140), 138, 139, *range(140, 180))),  # two were sent again
        *((second, k) for k in range(5, 160)),
        *((second, 2**21 + k) for k in range(3)),  # its count jumps
        *(
            (0, k) for k in (*range(60), *range(60))
        ),  # a driver that begins anew and does not say so
    ]
    sent = [msgspec.structs.replace(frame(k), publisher=camera) for camera, k in numbers]
    _write(tmp_path, sent, robots, part_bytes)
    frames = LoggedFrames(log_parts(tmp_path, print))

    def since(row: int) -> list[tuple[int, int, int, int]]:
        return [(n, f.index, f.publisher, f.stamp_ns) for n, f in frames.since(row)]

    whole = since(0)
    assert [item[0] for item in whole] == list(range(len(sent) - 2))
    assert [index for _, index, camera, _ in whole if camera == second] == list(range(180, 338))
    for row in (1, 99, 100, 103, 141, 180, 250, 334, 337, 340, 400, 452, 453):
        assert since(row) == whole[row:]


def test_a_source_that_begins_late_reads_no_chunk_long_before(tmp_path):
    _write(tmp_path, [frame(k) for k in range(400)])
    source = open_any_source(f"mcap:{tmp_path}")
    path = tmp_path / "run.mcap"
    torn = bytearray(path.read_bytes())
    until = len(torn) * 6 // 10
    torn[100:until] = b"\xff" * (until - 100)
    path.write_bytes(torn)
    assert [item.index for item in source.frames(380)] == list(range(380, 400))
    with pytest.raises(UserError, match="damaged"):
        next(iter(source.frames(200)))
