"""The fault of an unfinished log with damage in its middle, as from an SD card or a power cut."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_proto import topics
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.reading.files import log_parts
from hsslam_services.log.reading.reader import bus_messages

_MESSAGES, _MESSAGE_BYTES = 400, 60_000  # about 17 messages a chunk
_MOST_LOST = 2 * 18  # messages of two chunks
_READER = "hsslam_services.commands.log.command"


def one_word_is_damaged(experiment: Experiment) -> Finding:
    """Damage four bytes in the middle; expect the other chunks and the original file."""
    original = unfinished_log(experiment.folder)
    whole = _read(original, experiment.folder / "whole")
    content = bytearray(original.read_bytes())
    content[len(content) // 4 : len(content) // 4 + 4] = bytes(4)
    original.write_bytes(content)
    place = experiment.folder / "damaged"
    kept = _read(original, place)
    is_original_kept = any(path.read_bytes() == content for path in place.iterdir())
    return Finding(
        kept < whole - _MOST_LOST or not is_original_kept,
        f"{kept} of {whole} messages left after one damaged word; original kept: {is_original_kept}",
    )


def unfinished_log(folder: Path, messages: int = _MESSAGES) -> Path:
    """A log whose writer was killed: no index and no footer."""
    growing = folder / "growing.mcap"
    log = McapLog(growing, "robot")
    for index in range(messages):
        log.write(topics.STEP, os.urandom(_MESSAGE_BYTES), index + 1, index + 1, index)
    unfinished = folder / "unfinished.mcap"
    shutil.copy(growing, unfinished)
    log.close()
    growing.unlink()
    return unfinished


def _read(log: Path, place: Path) -> int:
    """Number of messages that a copy of the log has after `hsslam-log info`."""
    place.mkdir()
    copy = place / "run.mcap"
    shutil.copy(log, copy)
    done = subprocess.run(
        [sys.executable, "-P", "-m", _READER, "info", str(copy)], capture_output=True, text=True
    )
    if done.returncode:
        raise CouldNotTellError(f"hsslam-log info: {done.stderr.strip()}")
    return sum(1 for _ in bus_messages(log_parts(copy, lambda _: None)))
