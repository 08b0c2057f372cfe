"""Plan a path for a robot of 20 cm radius in a saved map or on its grid, and draw it.

    python examples/plan_path.py MAP [path.png [FROM_M TO_M]]
    python examples/plan_path.py map.yaml [path.png]

MAP is a run folder or a file such as map.safetensors; map.yaml is a grid that `hsslam-map grid` wrote.

The robot keeps its height. Its body is between the heights FROM_M and TO_M above the first camera: -0.1 and
0.1 (the default) for a drone, -1.1 and -0.6 for a robot on wheels if the camera is at 1.2 m. The path starts
at the point with most clearance, and ends at the farthest point in reach. Unobserved space counts as blocked.
"""

import math
import sys
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt
from skimage.graph import MCP_Geometric

from hsslam_node.dense_map.saved_map import SavedMap
from hsslam_node.errors import UserError
from hsslam_node.geometry.view_from_above import looking_down, mean_ahead, mean_up

CELL_M, RADIUS_M, REACH_M = 0.05, 0.2, 6.0
PIXELS = 5  # of the picture, for each cell


def main(map_file: str, picture: str = "path.png", from_m: str = "-0.1", to_m: str = "0.1") -> None:
    """Plan, print and draw."""
    heights_m = _metres(from_m), _metres(to_m)
    if not heights_m[0] < heights_m[1]:
        raise UserError(f"FROM_M {from_m} TO_M {to_m}: expected from < to")
    if map_file.endswith(".yaml"):
        points, clearance_m = clearance_on_grid(Path(map_file))
    else:
        points, clearance_m = clearance(SavedMap.open(map_file), *heights_m)
    path = plan(clearance_m)
    draw(clearance_m, path, picture)
    way = points[tuple(path.T)]  # [P, 3] m, world
    length_m = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
    narrowest_m = clearance_m[tuple(path.T)].min()
    print(f"from {way[0].round(2)} to {way[-1].round(2)} m: {length_m:.2f} m, {len(way)} cells")
    print(f"with {narrowest_m:.2f} m of room at the narrowest place; {picture}")


def _metres(text: str) -> float:
    try:
        metres = float(text)
    except ValueError:
        metres = math.nan
    if not math.isfinite(metres):
        raise UserError(f"{text}: expected a height in metres, as -0.1")
    return metres


def clearance(saved: SavedMap, from_m: float, to_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Points [n, n, 3] m of a level grid around the first camera, and the clearance [n, n] m of each.

    The clearance is the smallest distance, over the robot's heights, to a surface or to unobserved space.
    """
    poses = saved.trajectory().T_world_cam
    up, ahead = mean_up(poses), mean_ahead(poses)
    right, down, _ = looking_down(up, ahead, np.pi / 2).T  # of a picture from above
    steps = np.arange(-REACH_M, REACH_M + CELL_M / 2, CELL_M)
    points = poses[0, :3, 3] + steps[:, None, None] * down + steps[:, None] * right
    clearance_m = np.full(points.shape[:2], np.inf)
    known = np.ones(points.shape[:2], np.bool_)
    heights = 1 + max(1, math.ceil((to_m - from_m) / CELL_M))  # no surface lies between two of them
    for height_m in np.linspace(from_m, to_m, heights):
        found = saved.query((points + height_m * up).reshape(-1, 3))
        clearance_m = np.fmin(clearance_m, found.distance_m.reshape(known.shape))
        known &= found.known.reshape(known.shape)
    to_unknown_m = CELL_M * np.asarray(distance_transform_edt(known))
    return points, np.minimum(clearance_m, to_unknown_m)


def clearance_on_grid(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points [h, w, 3] m of the floor at the middles of cells, and the clearance [h, w] m of each.

    The clearance is the distance to the edge of the nearest cell that is occupied or unknown.
    """
    try:
        import yaml
    except ModuleNotFoundError:
        raise UserError(f"{file}: package PyYAML is not installed: pip install pyyaml") from None
    try:
        grid = yaml.safe_load(file.read_text())
        picture = cv2.imread(str(file.parent / grid["image"]), cv2.IMREAD_GRAYSCALE)
        cell_m, (x, y, _) = grid["resolution"], grid["origin"]
    except (OSError, yaml.YAMLError, KeyError, TypeError, ValueError) as error:
        raise UserError(f"{file}: {error!r}: expected a grid of hsslam-map grid") from None
    if picture is None:
        raise UserError(f"{file}: cannot read its picture {grid['image']}")
    is_free = 1 - picture / 255 < grid["free_thresh"]
    height, width = picture.shape
    columns, rows = np.meshgrid(np.arange(width) + 0.5, height - np.arange(height) - 0.5)
    points = np.stack([x + cell_m * columns, y + cell_m * rows, np.zeros_like(rows)], axis=-1)
    to_blocked = np.asarray(distance_transform_edt(np.pad(is_free, 1)))[1:-1, 1:-1]
    return points, cell_m * np.maximum(to_blocked - 0.5, 0.0)


def plan(clearance_m: np.ndarray) -> np.ndarray:
    """The cheapest path [P, 2] (rows, columns) from the cell with most clearance to the costliest in reach.

    Cells near walls cost more. Cells with less clearance than the robot's radius are blocked.
    """
    start = np.unravel_index(np.argmax(clearance_m), clearance_m.shape)
    if clearance_m[start] < RADIUS_M:
        raise UserError(
            f"{clearance_m[start]:.2f} m is the most room: expected {RADIUS_M} m; another height may have it"
        )
    room_m = np.maximum(clearance_m - RADIUS_M, 0.0)
    costs = np.where(clearance_m < RADIUS_M, np.inf, 1.0 + np.exp(-room_m / 0.2))
    search = MCP_Geometric(costs)
    reached, _ = search.find_costs([start])
    goal = np.unravel_index(np.argmax(np.where(np.isfinite(reached), reached, -1.0)), reached.shape)
    return np.array(search.traceback(goal))


def draw(clearance_m: np.ndarray, path: np.ndarray, picture: str) -> None:
    """A picture from above: lighter cells have more clearance, blocked ones are dark red, the path blue."""
    grey = np.clip(255 * clearance_m, 0, 255).astype(np.uint8)  # white: a metre
    image = cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR)
    image[clearance_m < RADIUS_M] = (40, 20, 80)
    image = np.kron(image, np.ones((PIXELS, PIXELS, 1), np.uint8))
    line = PIXELS * path[:, ::-1] + PIXELS // 2
    cv2.polylines(image, [line.astype(np.int32)], False, (230, 120, 20), 2, cv2.LINE_AA)
    rows, columns = (PIXELS * np.nonzero((clearance_m > 0).any(axis=a))[0] for a in (1, 0))
    image = image[rows[0] : rows[-1] + PIXELS, columns[0] : columns[-1] + PIXELS]
    try:
        is_written = cv2.imwrite(picture, image)
    except cv2.error:  # no format has this ending
        is_written = False
    if not is_written:
        raise UserError(f"{picture}: cannot be written: expected a .png in a folder that exists")


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3, 5) or sys.argv[1:] == ["--help"]:
        sys.exit(__doc__)
    try:
        main(*sys.argv[1:])
    except UserError as error:
        sys.exit(f"error: {error}")
