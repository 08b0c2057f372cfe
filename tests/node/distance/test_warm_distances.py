"""After the warm-up of distances, a window that moves compiles nothing."""

import subprocess
import sys

from hsslam_services.launch.spawn import child_environment
from tests.repository import ROOT

_REHEARSAL = """
import gc
import numpy as np
from numba.core.dispatcher import Dispatcher
from hsslam_node.distance.warm_distances import warm_distances

def signatures():
    kernels = [o for o in gc.get_objects() if isinstance(o, Dispatcher)]
    return {(k.py_func.__qualname__, str(s)) for k in kernels for s in k.signatures
            if k.py_func.__module__.startswith("hsslam_node.distance")}

warm_distances()
before = signatures()
from hsslam_node.distance.distance_blocks import DistanceBlocks
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.geometry.se3 import se3_exp
from tests.small_room import room_frames, room_poses

frames, poses = room_frames(), room_poses()
store = KeyframeStore.create(MemoryAllocator(), frames[0].camera, frames[0].depth_units_per_m, 64)
store.append(frames[0], poses[0])
window, meter, blocks = RollingWindow(store), DistanceMeter(), DistanceBlocks()
moves = set()
for k, aside_m in enumerate([0.0, 0.0, 0.0, 0.0, 1.0, 3.0, 3.0]):
    T = poses[k].copy()
    T[0, 3] += aside_m
    depth_m = frames[k].depth_raw * np.float32(1 / frames[k].depth_units_per_m)
    known = window.take(depth_m, frames[k].camera, T, store.count - 1)
    moves.add(known.grid.first)
    for _ in range(2):  # then none has changed
        blocks.renew(meter.measure(known))
    grid_map(known).distances_m()
assert len(moves) > 1, moves
print(len(before))
print(sorted(signatures() - before))
"""


def test_a_window_that_moves_compiles_nothing():
    done = subprocess.run(
        [sys.executable, "-c", _REHEARSAL],
        env=child_environment(), cwd=ROOT, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found, compiled = done.stdout.splitlines()
    assert int(found) > 10
    assert compiled == "[]"
