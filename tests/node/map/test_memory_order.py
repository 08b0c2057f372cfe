"""Counters and the data they count, hammered by a writer and a reader in two processes."""

import re
import subprocess
import sys
import time
from collections.abc import Callable

import llvmlite.binding as llvm
import numpy as np
import pytest

from hsslam_node.map.memory_order import FENCE, load_ordered, store_ordered

_ARRAYS = """
import os, sys, time
import numpy as np
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera
from hsslam_node.map.pose_log import POSE_ROW, PoseLog
from hsslam_node.map.store import KeyframeStore

class Files:
    def create(self, name, shape, dtype):
        path = f"{sys.argv[1]}/{name}.npy"
        try:
            return self.open(name)
        except KeyError:
            array = np.lib.format.open_memmap(path + ".new", "w+", np.dtype(dtype), tuple(shape))
            os.rename(path + ".new", path)
            return array
    def open(self, name):
        try:
            return np.load(f"{sys.argv[1]}/{name}.npy", mmap_mode="r+")
        except FileNotFoundError:
            raise KeyError(name)
    def exists(self, name):
        return os.path.exists(f"{sys.argv[1]}/{name}.npy")

arrays, stop_s = Files(), time.monotonic() + float(sys.argv[2])
"""
_WRITER = (
    _ARRAYS
    + """
camera = Camera(4, 3, 1.0, 1.0, 0.0, 0.0)
store = KeyframeStore.create(arrays, camera, 1000.0, 512)
log = PoseLog(arrays)
pixels = np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.uint16)
for _ in range(512):
    store.append(Frame(7, 7, camera, *pixels, 1000.0), np.zeros((4, 4)))
print("ready", flush=True)
ids, row, version = np.arange(512), np.zeros((), POSE_ROW), 0
while time.monotonic() < stop_s:
    version = store.correct_poses(ids, np.full((512, 4, 4), version + 1.0)).version
    row["index"] = row["map_epoch"] = log.count
    row["T_world_cam"] = row["T_keyframe_cam"] = log.count
    log.append(row)
print(version)
"""
)
_READER = (
    _ARRAYS
    + """
store, log = KeyframeStore(arrays), PoseLog(arrays)
reads = torn = newest = 0
while time.monotonic() < stop_s:
    poses = store.poses()
    torn += int((poses != poses[0, 0, 0]).any()) + int(poses[0, 0, 0] < newest)
    newest = poses[0, 0, 0]
    row = log.last()
    if row is not None:
        torn += int((row["T_world_cam"] != row["index"]).any() or row["map_epoch"] != row["index"])
    reads += 1
print(reads, torn, int(newest))
"""
)
_RETIRER = (
    _ARRAYS
    + """
camera = Camera(4, 3, 1.0, 1.0, 0.0, 0.0)
store = KeyframeStore.create(arrays, camera, 1000.0, 512)
pixels = np.zeros((3, 4, 3), np.uint8), np.zeros((3, 4), np.uint16)
for _ in range(512):
    store.append(Frame(7, 7, camera, *pixels, 1000.0), np.eye(4))
print("ready", flush=True)
slots = arrays.open("keyframe_slots")
kept, retired = slots.copy(), np.full_like(slots, -512)
while time.monotonic() < stop_s:
    slots[:] = retired
    slots[:] = kept
"""
)
_LISTER = (
    _ARRAYS
    + """
store = KeyframeStore(arrays)
lists = wrong = 0
while time.monotonic() < stop_s:
    wrong += int((store.kept() < 0).any())
    lists += 1
print(lists, wrong)
"""
)


def test_keyframes_that_retire_while_the_kept_are_listed_are_kept_or_not(tmp_path):
    retirer = _process(_RETIRER, tmp_path, 1)
    assert retirer.stdout is not None and retirer.stdout.readline() == "ready\n"
    lists, wrong = map(int, _process(_LISTER, tmp_path, 1).communicate(timeout=30)[0].split())
    retirer.communicate(timeout=30)
    assert lists > 100
    assert wrong == 0


def test_two_processes_at_full_speed_tear_nothing(tmp_path):
    writer = _process(_WRITER, tmp_path)
    assert writer.stdout is not None and writer.stdout.readline() == "ready\n"
    reader = _process(_READER, tmp_path)
    reads, torn, newest = map(int, reader.communicate(timeout=30)[0].split())
    versions = int(writer.communicate(timeout=30)[0])
    assert torn == 0
    assert reads > 100
    assert versions > 100
    assert newest > 0


def test_a_counter_costs_little_more_than_its_number():
    words = np.zeros(16, np.int64)
    store_ordered(words, 3, 5)
    assert load_ordered(words, 3) == 5
    # in turn, as other programs slow both
    shares = [_seconds_each(_ordered, words) / _seconds_each(_plain, words) for _ in range(20)]
    assert min(shares) < 10


@pytest.mark.parametrize(
    ("processor", "instructions"),
    [("aarch64-linux-gnu", r"dmb\s+ish\n"), ("x86_64-linux-gnu", r"mfence|lock\s+or")],
)
def test_the_fence_is_one_on_each_processor(processor, instructions):
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(processor).create_target_machine()
    assert re.search(instructions, machine.emit_assembly(llvm.parse_assembly(FENCE)))


def _ordered(words: np.ndarray, value: int) -> None:
    store_ordered(words, 3, value)
    load_ordered(words, 3)


def _plain(words: np.ndarray, value: int) -> None:
    words[3] = value
    int(words[3])


def _seconds_each(access: Callable[[np.ndarray, int], None], words: np.ndarray) -> float:
    begin_s = time.perf_counter()
    for value in range(500):
        access(words, value)
    return time.perf_counter() - begin_s


def _process(code: str, folder, seconds: int = 3) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", code, str(folder), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
