"""Faults of the recorder: it is killed late in a long run, or its disk is full."""

import contextlib
import os
import shutil
import subprocess
import time
from pathlib import Path

import psutil

from hsslam_bench.faults.damaged_log import unfinished_log
from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.runs.live_run import SMALL_ROOM

_LOG_MESSAGES = 5000  # of 60 kB: a log of 300 MB
_WATCH_S = 20.0
_DISK = "160m"
_LEFT_BYTES = 60_000_000  # less than the reserve of the log, and twice the map


def late_in_a_long_run(experiment: Experiment) -> Finding:
    """Kill the recorder after a log part of 300 MB; expect no second copy of it, and no lost pose."""
    long_part = unfinished_log(experiment.folder, _LOG_MESSAGES)
    part_bytes = long_part.stat().st_size
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000")
    run.wait_for_poses(30)
    before = run.pid_of("recorder")
    if before is None:
        raise CouldNotTellError("the recorder is not running")
    first_mb, _ = _peaks(before, run.out)
    psutil.Process(before).kill()
    long_part.rename(run.out / "run.1.mcap")  # as if the killed recorder had written it
    run.wait_until(lambda: run.pid_of("recorder") not in (None, before), 15)
    after = run.pid_of("recorder")
    if after is None:
        raise CouldNotTellError("the recorder has just ended")
    most_mb, most_bytes = _peaks(after, run.out)
    run.signal()
    code = run.finish()
    log = run.summary().get("log", {})
    # the new one needs 0.2 GB more, for a part of 75 MB as for one of 300 MB: less than the part itself
    is_copied = most_bytes > 1.5 * part_bytes
    dropped = log.get("poses_dropped", -1)
    return Finding(
        is_copied or code != 0 or dropped != 0 or most_mb > first_mb + part_bytes / 1e6,
        f"memory of the recorder at most {first_mb:.0f} MB, of the new one {most_mb:.0f} MB; run folder "
        f"at most {most_bytes / 1e6:.0f} MB, of which {part_bytes / 1e6:.0f} are the part; exit code {code}; "
        f"poses dropped {dropped}",
    )


def disk_is_full(experiment: Experiment) -> Finding:
    """Fill a disk of 160 MB; expect that the run continues, reports it, and writes trajectory and map."""
    disk = experiment.folder / "disk"
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={_DISK}", "tmpfs", str(disk)], check=True)
    try:
        run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000", out=disk / "run")
        run.wait_for_poses(60)
        filler = disk / "filler"
        free = shutil.disk_usage(disk).free
        with filler.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, max(free - _LEFT_BYTES, 1))
        sizes = [_sizes(run.out)]
        run.wait_for_poses(150)
        sizes.append(_sizes(run.out))
        run.signal()
        code = run.finish()
        lost = run.missing("trajectory.txt", "map.safetensors")
        grown = {
            name: size - sizes[0].get(name, 0)
            for name, size in sizes[1].items()
            if name.endswith((".rrd", ".mcap")) and size - sizes[0].get(name, 0) > 2_000_000
        }
        is_reported = "disk nearly full" in run.stderr
        experiment.close()
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=False)
    return Finding(
        bool(lost) or bool(grown) or not is_reported,
        f"exit code {code}; not written: {lost or 'nothing'}; grew by, bytes: {grown or 'nothing'}; "
        f"reported: {is_reported}",
    )


def _peaks(recorder: int, folder: Path) -> tuple[float, int]:
    """Largest memory of a recorder within 20 s, MB, and largest size of the run folder, bytes."""
    most_mb, most_bytes, begin_s = 0.0, 0, time.monotonic()
    while time.monotonic() - begin_s < _WATCH_S:
        with contextlib.suppress(psutil.Error):
            most_mb = max(most_mb, psutil.Process(recorder).memory_info().rss / 1e6)
        most_bytes = max(most_bytes, _used_bytes(folder))
        time.sleep(0.05)
    return most_mb, most_bytes


def _used_bytes(folder: Path) -> int:
    return sum(_sizes(folder).values())


def _sizes(folder: Path) -> dict[str, int]:
    found = {}
    for path in folder.iterdir():
        with contextlib.suppress(OSError):
            found[path.name] = path.stat().st_size if path.is_file() else 0
    return found
