"""A log on a disk whose power is cut while it is written."""

import subprocess
import sys
import time

from mcap.reader import make_reader

from hsslam_node.durable_file import durable_folder
from hsslam_services.log.reading.files import log_parts

WRITER = """
import sys, time
from pathlib import Path
from hsslam_proto import topics
from hsslam_services.log.parted_log import LogSettings, PartedLog
log = PartedLog(Path(sys.argv[1]), "r", LogSettings(part_bytes=1_000_000))
index = 0
while True:
    log.write(topics.STEP, b"x" * 5000, time.time_ns(), time.time_ns(), index)
    log.tick()
    index += 1
    time.sleep(0.004)
    if index % 50 == 0:
        print(index, flush=True)
"""


def test_a_power_cut_costs_two_seconds_of_the_log(disk):
    run_dir = disk.folder / "run"
    durable_folder(run_dir)
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(run_dir)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert writer.stdout is not None
        while int(writer.stdout.readline()) < 1000:  # 4 s or more
            pass
        cut_ns = time.time_ns()
        after = disk.cut() / "run"
    finally:
        writer.kill()
        writer.communicate()
    told: list[str] = []
    found: list[tuple[int, int]] = []
    for path in log_parts(after, told.append):
        with path.open("rb") as stream:
            found += [
                (message.sequence, message.log_time)
                for _, _, message in make_reader(stream, validate_crcs=True).iter_messages()
            ]
    assert [sequence for sequence, _ in found] == list(range(len(found)))
    assert cut_ns - found[-1][1] < 2e9
    assert not any("damaged" in text for text in told)
