"""Which way is up, and how high the floor lies: from the floor that cameras saw, else from their poses."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from hsslam_node.distance.kernels.level_points import sum_within, write_points
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.projection import world_points
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.geometry.view_from_above import mean_up
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.presets import REALTIME

UpSource = Literal[
    "gravity", "--up", "--base-T-camera", "level camera", "floor plane", "camera poses"
]
_MOST_VIEWS = 40
_ROWS_PX = 90  # of the image that is looked at
# about the direction so far: of normals that count for the next
_CONES_DEG = (40.0, 25.0, 15.0, 8.0)
_BIN_M = 0.02
_PEAK_SHARE = 0.25  # of the points at the best supported height: a lower floor has at least this
_THICKNESS_M = 0.05  # of a floor, to each side; depth noise is most of it
_FEWEST = 300  # points of a floor
_FLOOR_SHARE = 0.03  # of all points
_BELOW_M = 0.15  # the cameras
_TILT_DEG = 1.5  # floors and gravity that are found are less than this off


@dataclass(frozen=True)
class FloorPlane:
    """A horizontal plane in the world, and what it was found by."""

    up: tuple[float, float, float]  # unit length, world
    height_m: float  # along `up`, of the floor over the world's origin; negative below it
    source: UpSource
    is_seen: bool = True  # else `height_m` is that of the lowest points that were measured
    # a frame whose z is `up`, [4, 4], which the floor's keeps but for its height
    T_level_world: np.ndarray | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not np.isclose(np.linalg.norm(self.up), 1.0, atol=1e-6):
            raise ValueError(f"up {self.up} is no direction")

    @property
    def up_text(self) -> str:
        """`up`, for people."""
        return " ".join(f"{part + 0.0:.3f}" for part in self.up)

    @property
    def text(self) -> str:
        """Direction up, its source, and the height of the floor, for people."""
        up = f"direction up by {self.source}: {self.up_text}"
        at = f"at {self.height_m:.2f} m along it"
        if self.is_seen:
            return f"{up}; the floor {at}"
        near = " whose normal is within 40 degrees of it" if self.source == "camera poses" else ""
        return f"{up}; no floor seen{near}: the lowest measured points, {at}, stand for it"

    def tilt_against(self, seen: "FloorPlane") -> str | None:
        """For people: that `up` is not the direction up of a floor that was seen; None: it is, or the floor
        does not tell."""
        cosine = float(np.clip(np.dot(self.up, seen.up), -1, 1))
        tilt_deg = float(np.rad2deg(np.arccos(cosine)))
        if seen.source == "camera poses" or tilt_deg <= _TILT_DEG:
            return None
        return (
            f"direction up by {self.source} is {tilt_deg:.0f} degrees off that by {seen.source}: expected "
            "--base-T-camera with the tilt of the camera, in the run that began the map"
        )

    @property
    def T_floor_world(self) -> np.ndarray:
        """World to a frame with z up whose origin lies on the floor, [4, 4].

        It is `T_level_world` but for the height. Without that, its origin lies under that of the world, and
        its x points the way that the first camera looked, as far as that is horizontal.
        """
        if self.T_level_world is not None:
            T = self.T_level_world.copy()
            T[2, 3] = -self.height_m
            return T
        up = np.asarray(self.up)
        ahead = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
        x = ahead - (ahead @ up) * up
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.stack([x, np.cross(up, x), up])
        T[2, 3] = -self.height_m
        return T


def floor_by(
    gravity: Gravity | None,
    views: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    T_level_world: np.ndarray | None = None,
    max_depth_m: float = REALTIME.mapper.max_depth_m,
) -> FloorPlane:
    """The floor, with the axes of a frame whose z is up, [4, 4] (`level_frame`), if there is one, else with
    up against gravity if the map knows it; see `find_floor`."""
    if T_level_world is not None:
        up = T_level_world[2, :3]
        found = find_floor(views, camera, up, level_source(T_level_world), max_depth_m)
        return replace(found, T_level_world=T_level_world)
    if gravity is None:
        return find_floor(views, camera, max_depth_m=max_depth_m)
    return find_floor(views, camera, np.array(gravity.up), "gravity", max_depth_m)


def level_source(T_level_world: np.ndarray) -> UpSource:
    """The source of up in a level frame [4, 4]: without --base-T-camera the first camera counts as level."""
    is_default = np.allclose(T_level_world, RobotFrames().T_base_cam)
    return "level camera" if is_default else "--base-T-camera"


def find_floor(
    views: Sequence[tuple[np.ndarray, np.ndarray]],
    camera: Camera,
    up: np.ndarray | None = None,
    up_source: UpSource = "--up",
    max_depth_m: float = REALTIME.mapper.max_depth_m,
) -> FloorPlane:
    """The floor of what cameras saw.

    Normals of the depth images that lie near the cameras' mean up agree on a direction. The floor is the
    lowest height at which many such points lie; it is fitted by least squares. Without a floor, as with
    depth too sparse for normals, up is the cameras' mean up, and the floor the lowest that was seen. A camera
    that looks down by more than 40 degrees and does not turn needs `up`: its floor cannot be told from a
    wall; so does one that looks straight up and turns: its ceiling is taken for the floor.

    Args:
        views: depth [H, W] float32 m and T_world_cam [4, 4] of each.
        camera: of all views, undistorted.
        up: direction against gravity [3], world, if it is known; then only the height is searched for.
        up_source: where that comes from.
        max_depth_m: depth beyond is no floor: noise, or how a camera writes that it measured none.

    Raises:
        UserError: there is no view with depth, or `up` is no direction.
    """
    chosen = np.unique(np.linspace(0, len(views) - 1, min(len(views), _MOST_VIEWS)).astype(int))
    points, normals = _points_and_normals(
        (views[n] for n in chosen), len(chosen), camera, max_depth_m
    )
    if len(points) == 0:
        near = [np.where(views[n][0] < max_depth_m, views[n][0], 0) for n in chosen]
        seen = [world_points(z, camera, views[n][1]) for z, n in zip(near, chosen, strict=True)]
        points = np.concatenate([np.empty((0, 3)), *seen])
        normals = np.zeros_like(points)
    if len(points) == 0:
        raise UserError(f"floor: no view has depth below {max_depth_m:g} m: expected some")
    poses = np.stack([views[n][1] for n in chosen])
    if up is not None:
        return _below(points, normals, poses, _direction(up), up_source)
    start = mean_up(poses)
    direction, total = start, np.empty(3)
    for cone_deg in _CONES_DEG:
        near = sum_within(normals, direction, np.cos(np.deg2rad(cone_deg)), total)
        if near < _FEWEST:
            return _below(points, normals, poses, start, "camera poses")
        direction = _direction(total / near)
    on_floor = _floor_points(points, normals, poses, direction)
    if on_floor is None:
        return _below(points, normals, poses, start, "camera poses")
    direction = _fitted_normal(points[on_floor], direction)
    return FloorPlane(
        _triple(direction), float(np.median(points[on_floor] @ direction)), "floor plane"
    )


def _points_and_normals(
    views: Iterable[tuple[np.ndarray, np.ndarray]], count: int, camera: Camera, max_depth_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 3] m of n views and the normals of the surface about them, towards the camera; world.

    The views are read one after the other.
    """
    step = max(camera.height_px // _ROWS_PX, 1)
    a_view = -(-camera.height_px // step) * -(-camera.width_px // step)
    points, normals = np.empty((2, count * a_view, 3))
    end = 0
    for depth_m, T_world_cam in views:
        assert depth_m.shape == (camera.height_px, camera.width_px)
        end += write_points(
            np.ascontiguousarray(depth_m, np.float32), step,
            float(camera.fx), float(camera.fy), float(camera.cx), float(camera.cy),
            np.ascontiguousarray(T_world_cam, np.float64), float(max_depth_m), points[end:], normals[end:],
        )  # fmt: skip
    return points[:end], normals[:end]


def _floor_points(
    points: np.ndarray, normals: np.ndarray, poses: np.ndarray, up: np.ndarray
) -> np.ndarray | None:
    """Mask [N] of the points on the lowest level that is well supported; None if there is no such."""
    height = points @ up
    level = normals @ up > np.cos(np.deg2rad(_CONES_DEG[-2]))
    level &= height < np.median(poses[:, :3, 3] @ up) - _BELOW_M
    if level.sum() < _FEWEST:
        return None
    low = height[level].min()
    counts = np.bincount(((height[level] - low) / _BIN_M).astype(np.int64))
    window = np.convolve(counts, np.ones(5), mode="same")
    lowest = int(np.argmax(window >= _PEAK_SHARE * window.max()))
    peak = lowest + int(np.argmax(window[lowest : lowest + 6]))
    on_floor = level & (np.abs(height - low - (peak + 0.5) * _BIN_M) < _THICKNESS_M)
    enough = max(_FEWEST, _FLOOR_SHARE * len(points))
    return on_floor if on_floor.sum() >= enough else None


def _fitted_normal(points: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Normal [3] of the plane through points, on the side of `up`."""
    centred = points - points.mean(axis=0)
    normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
    return normal if normal @ up > 0 else -normal


def _below(
    points: np.ndarray, normals: np.ndarray, poses: np.ndarray, up: np.ndarray, source: UpSource
) -> FloorPlane:
    """The floor for a direction that is settled."""
    on_floor = _floor_points(points, normals, poses, up)
    if on_floor is not None:
        return FloorPlane(_triple(up), float(np.median(points[on_floor] @ up)), source)
    return FloorPlane(_triple(up), float(np.quantile(points @ up, 0.01)), source, is_seen=False)


def _direction(vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if not (np.isfinite(length) and length > 1e-9):
        raise UserError(f"--up {np.asarray(vector).tolist()}: expected a direction, three numbers")
    return np.asarray(vector, np.float64) / length


def _triple(direction: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in direction)
    return x, y, z
