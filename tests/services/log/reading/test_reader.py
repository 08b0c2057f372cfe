"""Messages of logs, old and damaged ones too."""

import msgspec
import numpy as np
import pytest

from hsslam_node.errors import UserError
from hsslam_proto import topics
from hsslam_services.commands.log.info import log_info
from hsslam_services.commands.log.trim import trim
from hsslam_services.log.parted_log import PartedLog
from hsslam_services.log.reading.reader import bus_messages
from tests.services.log.sample_log import write_poses
from tests.services.wire_samples import pose


def test_a_log_with_the_former_name_of_the_map_epoch_is_read(tmp_path):
    message = msgspec.structs.replace(pose(7), map_epoch=3)
    fields = msgspec.to_builtins(message)
    former = {"world" if name == "map_epoch" else name: value for name, value in fields.items()}
    log = PartedLog(tmp_path, "r")
    for payload in (msgspec.msgpack.encode(former), b"\xa5world, torn"):
        log.write(topics.POSE, payload, 1, 1, 0)
    log.close()
    read, torn = bus_messages([log.path])
    assert read.message() == message
    with pytest.raises(UserError, match="malformed"):
        torn.message()


def test_a_damaged_log_is_one_line(tmp_path):
    path = write_poses(tmp_path, 400)
    torn = bytearray(path.read_bytes())
    inside = (
        torn.index(b"lz4", len(torn) // 3) + 40
    )  # the name of the compression, then what it holds
    torn[inside : inside + 100] = bytes(100)
    path.write_bytes(torn)
    with pytest.raises(UserError, match=r"run\.mcap: damaged"):
        list(bus_messages([path]))


def test_whatever_is_damaged_in_a_log_is_one_line_or_does_no_harm(tmp_path):
    path = write_poses(tmp_path, 60)
    whole, told = path.read_bytes(), 0
    rng = np.random.default_rng(0)
    for _ in range(120):
        torn = bytearray(whole)
        at = int(rng.integers(8, len(whole) - 8))
        torn[at : at + 4] = rng.bytes(4)
        path.write_bytes(torn[: len(whole)])
        for read in (
            lambda: list(bus_messages([path])),
            lambda: list(log_info([path])),
            lambda: trim([path], tmp_path / "short.mcap", 0.0, None),
        ):
            try:
                read()
            except UserError as error:
                told += "\n" not in str(error)
    assert told > 60
