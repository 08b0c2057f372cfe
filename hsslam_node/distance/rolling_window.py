"""What is free and occupied about a camera as it moves: level, over the floor, at corrected poses."""

from collections import OrderedDict, deque
from typing import NamedTuple

import numpy as np

from hsslam_node.dense_map.keyframes import MapKeyframes, keyframes_of_store
from hsslam_node.distance.floor_plane import FloorPlane, floor_by
from hsslam_node.distance.occupancy import Occupancy
from hsslam_node.distance.spread_views import spread_views
from hsslam_node.distance.voxel_grid import VOXEL_M, VoxelGrid
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import inverse, transformed
from hsslam_node.geometry.view_distance import surface_shift_m
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import REALTIME

SIZE_M = (10.0, 10.0, 2.5)
_BELOW = 0.05  # of the height, below the floor
_WIDTH_PX = 320  # of the pixels looked at, at least
_STOREY_M = 2.5  # between floors, at least
_FLOOR_VIEWS = 16  # in which the floor is looked for; 50 ms
_MOST_KEYFRAMES = 64  # that a window is marked from at once; 0.3 s
# of these, the newest, 3 s at 30 Hz: the newest view of a place is the valid one
_NEWEST_KEYFRAMES = 24
_MOST_REFERENCES = 256  # keyframes whose corrections are looked at
_SHIFT = 0.5  # voxels by which marks may be off
# that are marked anew: 4 s, as keyframes leave out for 2 s what is new in a view (`dynamic_mask.py`); 12 MB
_RECENT_FRAMES = 40


class _SeenFrame(NamedTuple):
    """A frame that was marked, to mark it anew where its keyframe stands then."""

    depth_m: np.ndarray  # [H, W] float32, of the pixels looked at
    camera: Camera  # of them
    next_keyframe: int  # id of the first keyframe that came later
    keyframe: int
    T_keyframe_cam: np.ndarray  # [4, 4]


class RollingWindow:
    """Occupancy of a box that follows a camera; its frame has z up and the floor at z = 0.

    Frames are marked at the poses that they have when they come. If keyframes that they were tracked from
    have since been moved by half a voxel, or the floor turns out to be elsewhere, the window is marked anew
    from keyframes that are kept and stand in it, the newest and others that look at different places, and
    from the newest frames, in the order in which they came. Marks outside the window are forgotten. What the
    window comes to again, as it moves, is filled from the keyframes that stand there.

    Args:
        store: keyframes, in the world of the poses; one or more when a frame is taken. The window keeps their
            level frame but for its height; without one, up and the axes are those of the floor that they saw.
        size_m: along x, y and z.
        voxel_m: side of a voxel.
        max_depth_m: measurements beyond say nothing.
    """

    def __init__(
        self,
        store: KeyframeStore,
        size_m: tuple[float, float, float] = SIZE_M,
        voxel_m: float = VOXEL_M,
        max_depth_m: float = REALTIME.mapper.max_depth_m,
    ) -> None:
        self._store = store
        self._size_m, self._voxel_m, self._max_depth_m = size_m, voxel_m, max_depth_m
        self._looked_at = 0  # keyframes that there were when the floor was last looked for
        self._looked_from_m = 0.0  # height of the camera over the floor then
        self._pose_version = -1
        self._marked_version = -1  # of the poses that it was last marked anew at
        self._marked_at: OrderedDict[int, np.ndarray] = OrderedDict()  # T_world_cam of keyframes
        self._recent: deque[_SeenFrame] = deque(maxlen=_RECENT_FRAMES)
        self._count = 0  # of keyframes at the last frame
        self._included: set[int] = set()  # ids of keyframes whose views the window has
        self.floor: FloorPlane | None = None
        # for people, if gravity or the floor contradicts the level frame
        self.tilt: str | None = None
        self.occupancy: Occupancy | None = None

    def take(
        self,
        depth_m: np.ndarray,
        camera: Camera,
        T_world_cam: np.ndarray,
        keyframe: int,
        pose_version: int | None = None,
    ) -> Occupancy:
        """Take in a frame; returns what is known then.

        A frame whose pose is from before the correction that the window was marked anew for is left out.

        Args:
            depth_m: [H, W] float32, planar, 0 = no measurement.
            camera: undistorted.
            T_world_cam: [4, 4].
            keyframe: id of the one that the frame was tracked from; below 0: none.
            pose_version: of the store when the frame was tracked; None: now.
        """
        has_new_floor = self._look_for_floor(T_world_cam)
        occupancy = self.occupancy
        if occupancy is None or has_new_floor or self._keyframes_moved():
            occupancy = self._marked_anew(T_world_cam)
        else:
            has_joined = self._store.joined_since(self._count) > 0
            if not has_joined:  # frames show what the new keyframes show
                self._included.update(range(self._count, self._store.count))
            if occupancy.move_to(self._middle(T_world_cam)) or has_joined:
                self._fill(occupancy)
        self._count = self._store.count
        if pose_version is not None and pose_version < self._marked_version:
            return occupancy
        depth_m, camera = _thinned(depth_m, camera)
        occupancy.observe(depth_m, camera, T_world_cam)
        if 0 <= keyframe < self._store.count:
            T_world_keyframe, version = self._store.pose_at(keyframe)
            self._remember(keyframe, T_world_keyframe)
            if pose_version in (None, version):  # no correction came between
                seen = _SeenFrame(
                    depth_m, camera, self._store.count, keyframe,
                    inverse(T_world_keyframe) @ T_world_cam,
                )  # fmt: skip
                self._recent.append(seen)
        return occupancy

    def _look_for_floor(self, T_world_cam: np.ndarray) -> bool:
        """Look for it each time the keyframes have doubled, and if the camera is on another storey; whether
        it is elsewhere than before."""
        count, world = self._store.count, self._store.world_frame
        gravity, level = world.gravity, world.T_level_world
        is_new = gravity is not None and level is None
        is_new &= self.floor is not None and self.floor.source != "gravity"
        height_m = self._height_m(T_world_cam)
        is_on_another = self.floor is not None and not -_BELOW < height_m / self._size_m[2] < 1
        # else it has looked from there already
        is_on_another &= abs(height_m - self._looked_from_m) > _STOREY_M / 2
        is_due = self.floor is None or count >= 2 * self._looked_at or is_new
        if not (is_due or is_on_another):
            return False
        self._looked_at, self._looked_from_m = count, height_m
        keyframes = keyframes_of_store(self._store)
        here = np.arange(len(keyframes))
        if self.floor is not None:  # else nothing is known of storeys
            places = transformed(self.T_floor_world, keyframes.T_world_cam[:, :3, 3])
            here = here[np.abs(places[:, 2] - height_m) < _STOREY_M / 2]
        if not len(here):
            return False
        chosen = here[np.linspace(0, len(here) - 1, min(len(here), _FLOOR_VIEWS)).astype(int)]
        views = [keyframes.views[k] for k in chosen.tolist()]
        found = floor_by(gravity, views, keyframes.camera, level, self._max_depth_m)
        if level is not None and self.tilt is None:
            seen = floor_by(gravity, views, keyframes.camera, max_depth_m=self._max_depth_m)
            self.tilt = found.tilt_against(seen)
        T_before, before = self.T_floor_world, self.floor
        self.floor = found
        if before is not None:
            poses = np.stack([inverse(T) for T in (T_before, self.T_floor_world)])
            is_there = surface_shift_m(poses[:1], poses[1:]) <= self._voxel_m
            if is_there and found.source == before.source:
                self.floor = before
        self._looked_from_m = self._height_m(T_world_cam)
        return self.floor is not before

    def _height_m(self, T_world_cam: np.ndarray) -> float:
        """Height of a camera over the floor."""
        return float((self.T_floor_world @ T_world_cam[:, 3])[2])

    @property
    def T_floor_world(self) -> np.ndarray:
        """World to the frame of the window, [4, 4]; the identity before the first frame."""
        return np.eye(4) if self.floor is None else self.floor.T_floor_world

    def _keyframes_moved(self) -> bool:
        """Whether corrections since have moved what was marked."""
        version = self._store.pose_version
        if version == self._pose_version or not self._marked_at:
            return False
        self._pose_version = version
        ids = np.fromiter(self._marked_at, np.int64)
        then = np.stack(list(self._marked_at.values()))
        return surface_shift_m(then, self._store.poses_of(ids)) > _SHIFT * self._voxel_m

    def _marked_anew(self, T_world_cam: np.ndarray) -> Occupancy:
        """A window about a camera, marked from keyframes and recent frames, the newest last."""
        height_m = (0.5 - _BELOW) * self._size_m[2]
        middle = self.T_floor_world @ T_world_cam[:, 3]
        grid = VoxelGrid.around(np.array([*middle[:2], height_m]), self._size_m, self._voxel_m)
        occupancy = self.occupancy = Occupancy(
            grid, self.T_floor_world, max_depth_m=self._max_depth_m
        )
        self._marked_at.clear()
        self._pose_version = self._marked_version = self._store.pose_version
        keyframes, recent = keyframes_of_store(self._store), deque(self._recent)
        within = self._within(grid, keyframes)
        self._included = set(keyframes.ids[within].tolist())
        for k in _spread(keyframes, within):
            while recent and recent[0].next_keyframe <= keyframes.ids[k]:
                self._mark(recent.popleft(), occupancy)
            self._mark_keyframe(keyframes, k, occupancy)
        for frame in recent:
            self._mark(frame, occupancy)
        return occupancy

    def _fill(self, occupancy: Occupancy) -> None:
        """Fill what is unknown from the keyframes that stand in a window and that it does not include."""
        keyframes = keyframes_of_store(self._store)
        within = self._within(occupancy.grid, keyframes)
        ids = keyframes.ids[within]
        is_new = ~np.isin(ids, np.fromiter(self._included, np.int64))
        self._included = set(ids.tolist())
        if not is_new.any():
            return
        before = Occupancy(occupancy.grid, self.T_floor_world, max_depth_m=self._max_depth_m)
        for k in _spread(keyframes, within[is_new]):
            self._mark_keyframe(keyframes, k, before)
        occupancy.fill_from(before)

    def _mark_keyframe(self, keyframes: MapKeyframes, k: int, occupancy: Occupancy) -> None:
        """Mark the k-th of the keyframes."""
        depth_m, T = keyframes.views[k]
        occupancy.observe(*_thinned(depth_m, keyframes.camera), T)
        self._remember(int(keyframes.ids[k]), T)

    def _mark(self, frame: _SeenFrame, occupancy: Occupancy) -> None:
        """Mark a recent frame where its keyframe stands now."""
        T_world_keyframe = self._store.pose(frame.keyframe)
        T = T_world_keyframe @ frame.T_keyframe_cam
        occupancy.observe(frame.depth_m, frame.camera, T)
        self._remember(frame.keyframe, T_world_keyframe)

    def _within(self, grid: VoxelGrid, keyframes: MapKeyframes) -> np.ndarray:
        """Numbers [n] of the keyframes that stand in a grid, or up to a metre over or under it."""
        T = self.T_floor_world
        places = transformed(T, keyframes.T_world_cam[:, :3, 3])
        aside_m = np.array([0.0, 0.0, 1.0])
        inside = (places >= grid.low - aside_m) & (places <= grid.high + aside_m)
        return np.flatnonzero(inside.all(axis=1))

    def _middle(self, T_world_cam: np.ndarray) -> np.ndarray:
        """The place [3] m, world, that the window is to be about: the camera's, at the window's height."""
        assert self.occupancy is not None
        T, grid = self.T_floor_world, self.occupancy.grid
        place = T @ T_world_cam[:, 3]
        place[2] = (grid.low[2] + grid.high[2]) / 2
        return (inverse(T) @ place)[:3]

    def _remember(self, keyframe: int, T_world_cam: np.ndarray) -> None:
        self._marked_at.setdefault(keyframe, T_world_cam)
        self._marked_at.move_to_end(keyframe)
        if len(self._marked_at) > _MOST_REFERENCES:
            self._marked_at.popitem(last=False)


def _spread(keyframes: MapKeyframes, rows: np.ndarray) -> list[int]:
    """Of rows of keyframes, those that a window is marked from."""
    chosen = spread_views(keyframes.T_world_cam[rows], _MOST_KEYFRAMES, _NEWEST_KEYFRAMES)
    return rows[chosen].tolist()


def _thinned(depth_m: np.ndarray, camera: Camera) -> tuple[np.ndarray, Camera]:
    """The pixels that a window is marked from, a copy, and their camera."""
    step = max(camera.width_px // _WIDTH_PX, 1)
    chosen = depth_m[::step, ::step].copy()
    height, width = chosen.shape
    fx, fy, cx, cy = (n / step for n in (camera.fx, camera.fy, camera.cx, camera.cy))
    return chosen, Camera(width, height, fx, fy, cx, cy)
