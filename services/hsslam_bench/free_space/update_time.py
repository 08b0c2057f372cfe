"""Measures the core time of an update of a rolling window, and the speed of queries; prints JSON.

`python -m hsslam_bench.free_space.update_time SOURCE [--noise kinect]` takes every third frame of 30 Hz at
its true pose. An update moves the window with the camera, observes the depth, measures all distances, makes
the grid map, and prepares the distances over the floor and the changed blocks for their messages. Every
fourth frame is a keyframe. Times are process times (`time.process_time`).
"""

import argparse
import json
import statistics
import time

import numpy as np

from hsslam_bench.field_error.true_frames import true_frames
from hsslam_bench.free_space.distance_errors import free_points
from hsslam_node.distance.distance_blocks import DistanceBlocks
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.sources.options.source import SourceOptions

_EVERY, _KEYFRAME_EVERY = 3, 4  # frames
_MOST_KEYFRAMES = 1024
_WARM_UP = 5  # updates
_QUERIES = 1_000_000
_TURNS = 5  # the result is their median


def main() -> None:
    parser = argparse.ArgumentParser(prog="free_space.update_time", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--quick", action="store_true", help="a few frames")
    arguments = parser.parse_args()
    frames = 40 if arguments.quick else None
    print(
        json.dumps(
            update_time(arguments.source, SourceOptions(noise=arguments.noise, frames=frames))
        )
    )


def update_time(spec: str, options: SourceOptions) -> dict[str, float]:
    """Mean, median and 99 % quantile of an update, ms; means of its parts, ms; points queried a second."""
    window: RollingWindow | None = None
    store: KeyframeStore | None = None
    meter, blocks, distances = DistanceMeter(), DistanceBlocks(), None
    parts: list[list[float]] = []
    for index, view in enumerate(true_frames(spec, options)):
        frame, T_world_cam = view.frame, view.T_world_cam
        if store is None or window is None:
            arrays, units = MemoryAllocator(), frame.depth_units_per_m
            store = KeyframeStore.create(arrays, frame.camera, units, _MOST_KEYFRAMES)
            window = RollingWindow(store)
        if index % _KEYFRAME_EVERY == 0:
            store.append(frame, T_world_cam)
        if index % _EVERY:
            continue
        depth_m = frame.depth_m()
        stamps = [time.process_time()]
        known = window.take(depth_m, frame.camera, T_world_cam, store.count - 1)
        stamps.append(time.process_time())
        distances = meter.measure(known)
        stamps.append(time.process_time())
        grid = grid_map(known)
        stamps.append(time.process_time())
        grid.distances_m()
        blocks.renew(distances)
        stamps.append(time.process_time())
        parts.append(np.diff(stamps).tolist())
    assert distances is not None
    ms = 1e3 * np.array(parts[_WARM_UP:])
    total = ms.sum(axis=1)
    return {
        "mean_ms": float(total.mean()),
        "median_ms": float(np.median(total)),
        "p99_ms": float(np.quantile(total, 0.99)),
        "observe_ms": float(ms[:, 0].mean()),
        "distances_ms": float(ms[:, 1].mean()),
        "grid_ms": float(ms[:, 2].mean()),
        "slice_and_blocks_ms": float(ms[:, 3].mean()),
        "updates": len(total),
        "points_per_s": _points_per_s(distances),
    }


def _points_per_s(distances: DistanceMap) -> float:
    points = free_points(distances, _QUERIES, 0).astype(np.float32)
    took_s = []
    for _ in range(_TURNS):
        start = time.process_time()
        distances.query(points)
        took_s.append(time.process_time() - start)
    return len(points) / statistics.median(took_s)


if __name__ == "__main__":
    main()
