"""Core time of one update of a rolling window, and speed of its queries, as JSON on stdout.

`python -m hsslam_bench.free_space.update_time SOURCE [--noise kinect]`: every third frame of 30 Hz is
taken in at its true pose: the window follows the camera, observes the depth, measures all distances and
makes the grid map. Times are of the process (`time.process_time`), not of the clock.
"""

import argparse
import json
import time

import numpy as np

from hsslam_bench.field_error.true_frames import true_frames
from hsslam_bench.free_space.distance_errors import free_points
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import find_floor
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.voxel_grid import VoxelGrid
from hsslam_node.sources.options import SourceOptions

_SIZE_M, _VOXEL_M = (10.0, 10.0, 2.5), 0.05
_EVERY = 3  # frames
_WARM_UP = 5  # updates
_QUERIES = 1_000_000
_TURNS = 5
_WIDTH_PX = 320  # of the pixels looked at, at least


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
    """Mean and greatest ms of an update, mean ms of its parts, and points asked a second."""
    occupancy: Occupancy | None = None
    meter, distances = DistanceMeter(), None
    parts: list[list[float]] = []
    for index, view in enumerate(true_frames(spec, options)):
        if index % _EVERY:
            continue
        depth_m, camera = view.frame.depth_m(), view.frame.camera
        if occupancy is None:
            floor = find_floor([(depth_m, view.T_world_cam)], camera)
            height = np.array([0.0, 0.0, 0.45 * _SIZE_M[2]])
            occupancy = Occupancy(VoxelGrid.around(height, _SIZE_M, _VOXEL_M), floor.T_floor_world)
        stamps = [time.process_time()]
        occupancy.move_to(_over_floor(occupancy, view.T_world_cam))
        occupancy.observe(depth_m, camera, view.T_world_cam, max(camera.width_px // _WIDTH_PX, 1))
        stamps.append(time.process_time())
        distances = meter.measure(occupancy)
        stamps.append(time.process_time())
        grid_map(distances)
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
        "updates": len(total),
        "points_per_s": _points_per_s(distances),
    }


def _over_floor(occupancy: Occupancy, T_world_cam: np.ndarray) -> np.ndarray:
    """The camera's place, world, at the height that the window has."""
    T = occupancy.T_grid_world
    place = T[:3, :3] @ T_world_cam[:3, 3] + T[:3, 3]
    place[2] = (occupancy.grid.low[2] + occupancy.grid.high[2]) / 2
    return T[:3, :3].T @ (place - T[:3, 3])


def _points_per_s(distances: DistanceMap) -> float:
    points = free_points(distances, _QUERIES, 0).astype(np.float32)
    took_s = []
    for _ in range(_TURNS):
        start = time.process_time()
        distances.query(points)
        took_s.append(time.process_time() - start)
    return len(points) / min(took_s)


if __name__ == "__main__":
    main()
