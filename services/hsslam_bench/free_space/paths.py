"""Plans paths of a robot on the distances of a map and on exact ones, and counts collisions; prints JSON.

`python -m hsslam_bench.free_space.paths SOURCE SEED [--noise kinect] [--poses tracked|true]`: the robot is a
ball of 20 cm radius, 0.5 m above the floor. It may go where keyframes saw all of its body. Random starts and
goals have 10 cm more true distance than the radius. Paths on the map's distances keep 5 cm more than the
radius, for the errors of the distances. A path collides if the true mesh is nearer than the radius anywhere.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import torch
from skimage.graph import MCP_Geometric

from hsslam_bench.free_space.distance_errors import TrueDistances, measure_from
from hsslam_bench.free_space.run import tracked_views, true_views
from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.distance.distance_map import DistanceMap
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.floor_plane import find_floor
from hsslam_node.distance.whole_map import whole_map
from hsslam_node.errors import UserError
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.presets import PRESETS
from hsslam_node.sources.options.source import SourceOptions

RADIUS_M, _HEIGHT_M, _MARGIN_M = 0.2, 0.5, 0.05
_ENDS_M = 0.1  # extra distance at start and goal
_PAIRS = 1000
_STEP_M = 0.01  # between the points of a path that are checked against the mesh
_SOFT_M = 0.2  # decay of the cost of a cell with its distance beyond the radius
_QUICK_FRAMES, _QUICK_PAIRS = 40, 20


@dataclass(frozen=True)
class Level:
    """A horizontal slice of a map: [nx, ny] cells."""

    points: np.ndarray  # [nx, ny, 3] m, world, centres
    distance_m: np.ndarray  # of the map; nan: not known
    true_m: np.ndarray  # to the true mesh
    measure: Callable[[np.ndarray], TrueDistances]  # of points [N, 3] m, world
    is_seen: np.ndarray  # bool: keyframes saw all space within the radius


@dataclass(frozen=True)
class PathCounts:
    """Counts over pairs of start and goal."""

    pairs: int
    exact: int  # paths found on exact distances
    both: int  # pairs with a path on both
    found: int  # paths found on the map's distances
    colliding: int  # of these
    narrowest_m: float  # least true distance on these


def main() -> None:
    parser = argparse.ArgumentParser(prog="free_space.paths", description=__doc__)
    parser.add_argument("source")
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--poses", choices=("tracked", "true"), default="tracked")
    parser.add_argument("--quick", action="store_true", help="a few frames and pairs")
    arguments = parser.parse_args()
    frames = _QUICK_FRAMES if arguments.quick else None
    options = SourceOptions(noise=arguments.noise, seed=arguments.seed, frames=frames)
    torch.set_num_threads(1)
    config = PRESETS["realtime"]
    look = tracked_views if arguments.poses == "tracked" else true_views
    seen = look(config, arguments.source, options)
    floor = find_floor(seen.views, seen.camera)
    distances = DistanceMeter().measure(whole_map(seen.views, seen.camera, floor))
    pairs = _QUICK_PAIRS if arguments.quick else _PAIRS
    counts = plan_pairs(level_of(distances, arguments.source, options), pairs, arguments.seed)
    print(json.dumps({"up": floor.source, "keyframes": len(seen.views), **asdict(counts)}))


def level_of(distances: DistanceMap, spec: str, options: SourceOptions) -> Level:
    """The slice at the robot's height, with its true distances."""
    _, truth = source_with_truth(spec, options)
    mesh = truth.mesh()
    if mesh is None:
        raise UserError(f"source {spec}: expected a true mesh")
    grid = distances.grid
    z = round(_HEIGHT_M / grid.voxel_m) - grid.first[2]
    if not 0 <= z < grid.shape[2]:
        raise UserError(f"source {spec}: expected space {_HEIGHT_M} m above the floor")
    nx, ny, _ = grid.shape
    indices = np.argwhere(np.ones((nx, ny), np.bool_))
    indices = np.column_stack([indices, np.full(len(indices), z)])
    T = inverse(distances.T_grid_world)
    points = transformed(T, grid.centres(indices))
    measure = measure_from(mesh, inverse(truth.T_world_cam[0]))
    # space behind the nearest surface is never seen, and need not be
    distance_m = distances.distance_m[:, :, z]
    is_seen = distances.to_unknown_m[:, :, z] > np.fmin(RADIUS_M, distance_m - grid.voxel_m)
    true_m = measure(points).distance_m.reshape(nx, ny)
    return Level(points.reshape(nx, ny, 3), distance_m, true_m, measure, is_seen)


def plan_pairs(level: Level, pairs: int, seed: int) -> PathCounts:
    """Draw starts and goals, plan each pair on both distances, and check the map's paths for collisions.

    Raises:
        UserError: the robot fits in no cell.
    """
    known = np.isfinite(level.distance_m) & level.is_seen
    true_room = np.where(known, level.true_m, -np.inf)
    own_room = np.where(known, level.distance_m - _MARGIN_M, -np.inf)
    fits = np.argwhere(true_room >= RADIUS_M + _ENDS_M)
    if len(fits) == 0:
        raise UserError("paths: the robot fits nowhere: expected free space that keyframes saw")
    rng = np.random.default_rng(seed)
    ends = fits[rng.integers(len(fits), size=(pairs, 2))]
    exact = both = found = colliding = 0
    narrowest_m = np.inf
    for start, goal in ends:
        by_exact = path(true_room, start, goal) is not None
        ours = path(own_room, start, goal)
        exact += by_exact
        if ours is None:
            continue
        found += 1
        both += by_exact
        least_m = float(level.measure(_along(level.points[tuple(ours.T)])).distance_m.min())
        colliding += least_m < RADIUS_M
        narrowest_m = min(narrowest_m, least_m)
    return PathCounts(pairs, exact, both, found, colliding, narrowest_m)


def path(room_m: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray | None:
    """The cheapest path [P, 2] over cells with distances [nx, ny] m of at least the radius; None: no path."""
    spare_m = np.maximum(room_m - RADIUS_M, 0.0)
    costs = np.where(room_m < RADIUS_M, np.inf, 1.0 + np.exp(-spare_m / _SOFT_M))
    if not np.isfinite([costs[tuple(start)], costs[tuple(goal)]]).all():
        return None
    search = MCP_Geometric(costs)
    reached, _ = search.find_costs([tuple(start)], [tuple(goal)])
    if not np.isfinite(reached[tuple(goal)]):
        return None
    return np.array(search.traceback(tuple(goal)))


def _along(way: np.ndarray) -> np.ndarray:
    """Points [N, 3] m on the line through points [P, 3] m, at most a step apart."""
    if len(way) == 1:
        return way
    steps = int(np.ceil(np.linalg.norm(np.diff(way, axis=0), axis=1).max() / _STEP_M))
    share = np.arange(steps)[:, None, None] / steps
    between = (1 - share) * way[:-1] + share * way[1:]
    return np.concatenate([between.reshape(-1, 3), way[-1:]])


if __name__ == "__main__":
    main()
