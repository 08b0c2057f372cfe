"""Faults of time: the wall clock steps by an hour, or a recording has a gap."""

import shutil
import struct
import subprocess
import time
from pathlib import Path

import cv2
import numpy as np

from hsslam_bench.faults.experiment import Experiment
from hsslam_bench.faults.fault import CouldNotTellError, Finding
from hsslam_bench.faults.strange_frames import small_room_frames
from hsslam_bench.runs.live_run import SMALL_ROOM

_HOUR_S = 3600
_WATCH_S = 10.0
_RATE_HZ = 15.0
_LEAST_SHARE = 0.6  # of the frames that the camera sends in that time
_GAP_S, _GAP_FRAMES, _MOST_S = 400.0, 90, 120.0
# Preloaded library: it shifts the wall clock of the service by the number of seconds in a file.
_CLOCK = r"""
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
static volatile int64_t *offset_s;
__attribute__((constructor)) static void begin(void) {
    int file = open(getenv("CLOCK_OFFSET"), O_RDONLY);
    void *place = mmap(0, 8, PROT_READ, MAP_SHARED, file, 0);
    if (place != MAP_FAILED) offset_s = place;
    close(file);
}
int clock_gettime(clockid_t clock, struct timespec *now) {
    int code = syscall(SYS_clock_gettime, clock, now);
    if (code == 0 && clock == CLOCK_REALTIME && offset_s) now->tv_sec += *offset_s;
    return code;
}
"""


def wall_clock_steps(experiment: Experiment) -> Finding:
    """Step an hour back, then two forward, while the camera sends; expect poses at the sensor's rate."""
    offset, library = _clock_library(experiment.folder)
    prefix = ("env", f"LD_PRELOAD={library}", f"CLOCK_OFFSET={offset}")
    run = experiment.serve(*SMALL_ROOM, "--synth.length", "3000", prefix=prefix)
    run.wait_for_poses(30)
    came: dict[int, int] = {}
    for hours in (-1, 1):
        with offset.open("r+b") as file:  # in place: a mapped file that is truncated is a SIGBUS
            file.write(struct.pack("<q", hours * _HOUR_S))
        before = len(run.new_poses())
        time.sleep(_WATCH_S)
        came[hours] = len(run.new_poses()) - before
    run.signal()
    code = run.finish()
    if run.stderr.count("the wall clock was set by") < 2:
        raise CouldNotTellError("the clock of the run did not step")
    expected = _WATCH_S * _RATE_HZ
    return Finding(
        min(came.values()) < _LEAST_SHARE * expected or code != 0,
        f"poses in {_WATCH_S:g} s, of {expected:g}: {came[-1]} after an hour back, {came[1]} after two "
        f"forward; exit code {code}",
    )


def gap_in_a_recording(experiment: Experiment) -> Finding:
    """A recording with 400 s without frames; expect a notice and no waiting."""
    folder = _recording_with_gap(experiment.folder / "gap")
    words = [word for word in SMALL_ROOM if word not in ("--rate-hz", "15")]
    run = experiment.serve(*words, "--source", f"tum:{folder}")
    code = run.ends_within(_MOST_S)
    has_hung = "made no progress" in run.stderr
    is_reported = "the stamps have a gap of" in run.stderr
    return Finding(
        code != 0 or has_hung or not is_reported,
        f"exit code {code} (None: still running after {_MOST_S:g} s); taken for hung: {has_hung}; "
        f"reported: {is_reported}",
    )


def _clock_library(folder: Path) -> tuple[Path, Path]:
    """Make the file with the offset in seconds, and the library that adds it to the clock."""
    if shutil.which("cc") is None:
        raise CouldNotTellError("no C compiler (cc) to make a clock that steps")
    source, library, offset = (folder / name for name in ("clock.c", "clock.so", "offset"))
    source.write_text(_CLOCK)
    command = ["cc", "-shared", "-fPIC", "-O2", "-o", str(library), str(source)]
    subprocess.run(command, check=True, capture_output=True)
    offset.write_bytes(bytes(8))
    return offset, library


def _recording_with_gap(folder: Path) -> Path:
    lists: dict[str, list[str]] = {"rgb": [], "depth": []}
    for kind in lists:
        (folder / kind).mkdir(parents=True)
    frames = small_room_frames(_GAP_FRAMES)
    for frame in frames:
        stamp_s = frame.index / _RATE_HZ + (_GAP_S if frame.index >= _GAP_FRAMES // 2 else 0.0)
        depth = np.round(frame.depth_m() * 5000).astype(np.uint16)
        color = cv2.cvtColor(frame.color, cv2.COLOR_RGB2BGR)
        for kind, image in (("rgb", color), ("depth", depth)):
            cv2.imwrite(str(folder / kind / f"{frame.index}.png"), image)
            lists[kind].append(f"{stamp_s:.6f} {kind}/{frame.index}.png")
    for kind, lines in lists.items():
        (folder / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    camera = frames[0].camera
    size = f'"width": {camera.width_px}, "height": {camera.height_px}'
    lens = f'"fx": {camera.fx}, "fy": {camera.fy}, "cx": {camera.cx}, "cy": {camera.cy}'
    (folder / "camera.json").write_text(f'{{{size}, {lens}, "depth_scale": 5000}}')
    return folder
