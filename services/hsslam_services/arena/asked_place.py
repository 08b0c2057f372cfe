"""Answers the request `locate`: the tracker looks for the camera near the pose that a client names."""

import threading
from collections.abc import Sequence

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.dense_map.keyframes import keyframes_of_store
from hsslam_node.distance.floor_plane import UpSource, floor_by, level_source
from hsslam_node.geometry.floor_pose import FloorFrames, FloorPose
from hsslam_node.geometry.robot_frames import RobotFrames
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.tracked_frame import TrackResult
from hsslam_proto.request_messages import Locate, Located, Refusal
from hsslam_services.arena.map_state import MapState
from hsslam_services.arena.shared_map import SharedMap

_MOST_FRAMES = 10  # in which the tracker looks for the camera
_LONGEST_S = 10.0


class AskedPlace:
    """A thread of the bus waits in `answer`, for one client at a time. The tracker's loop tracks the next
    frame with `near`, and hands the result to `take`.
    """

    def __init__(
        self, arrays: ArrayAllocator, config: SlamConfig, mode: MapState,
        base_T_camera: Sequence[float],
    ) -> None:  # fmt: skip
        """`base_T_camera`: as for `RobotFrames.mounted`."""
        self._link = SharedMap(arrays, config)
        self._mode = mode
        self._max_depth_m = config.mapper.max_depth_m
        self._knows_places = config.tracker.method != "rendering"
        self._T_base_cam = RobotFrames.mounted(base_T_camera).T_base_cam
        self._changed = threading.Condition()
        self._near: Whereabouts | None = None
        self._result: TrackResult | None = None  # of the newest frame since the question
        self._frames = 0
        self._is_closed = False

    @property
    def near(self) -> Whereabouts | None:
        """Where to look for the camera in the next frame; None: no client asks."""
        return self._near

    def take(self, result: TrackResult) -> None:
        """Take in the result of a frame; ignored if no client asks."""
        near = self._near
        if near is None:
            return
        with self._changed:
            self._result = result
            self._frames += 1
            is_settled = _is_in_map(result) and not self._mode.localise_only
            if is_settled or _is_there(result, near) or self._frames >= _MOST_FRAMES:
                self._near = None
                self._changed.notify_all()

    def answer(self, question: Locate) -> Located | Refusal:
        """The pose of the camera, or why it was not found; waits for frames."""
        if not self._knows_places:
            text = "locate: --slam.tracker.method rendering cannot relocalise: expected alignment"
            return Refusal(reason="failed", text=text)
        store = self._link.store()
        if store is None or store.count == 0:
            return Refusal(reason="not_now", text="locate: there is no map yet: expected keyframes")
        frames, up_by = self._floor(store)
        at = FloorPose(question.x, question.y, float(np.deg2rad(question.yaw_deg)))
        known = store.poses_of(store.kept())
        near = Whereabouts(frames.camera_at(at, known), frames.up)
        if len(near.keyframes(store)) == 0:
            return Refusal(reason="failed", text=_far_from_all(at, frames, known))
        return self._looked_for(near, at, frames, up_by)

    def close(self) -> None:
        """No more frames come; a waiting `answer` returns."""
        with self._changed:
            self._is_closed, self._near = True, None
            self._changed.notify_all()

    def _floor(self, store: KeyframeStore) -> tuple[FloorFrames, UpSource]:
        """The floor frame, as for `hsslam-map grid` and `--grid`, and the source of the up direction."""
        if (level := store.world_frame.T_level_world) is not None:
            return FloorFrames(level, self._T_base_cam), level_source(level)
        keyframes = keyframes_of_store(store)
        gravity = store.world_frame.gravity
        floor = floor_by(gravity, keyframes.views, keyframes.camera, max_depth_m=self._max_depth_m)
        return FloorFrames(floor.T_floor_world, self._T_base_cam), floor.source

    def _looked_for(
        self, near: Whereabouts, at: FloorPose, frames: FloorFrames, up_by: UpSource
    ) -> Located | Refusal:
        with self._changed:
            self._result, self._frames, self._near = None, 0, None if self._is_closed else near
            self._changed.wait_for(lambda: self._near is None, _LONGEST_S)
            self._near, result = None, self._result
        if result is None and self._is_closed:
            return Refusal(reason="not_now", text="locate: the run ends: expected one that goes on")
        if result is None:
            text = (
                f"locate: no frame for {_LONGEST_S:g} s: expected a camera that sends frames, and no pause "
                "(hsslam-ctl resume)"
            )
            return Refusal(reason="not_now", text=text)
        if not _is_there(result, near):
            return Refusal(reason="failed", text=_not_there(at, result, frames))
        found = frames.pose_of(result.T_world_cam)
        return Located(
            index=result.frame_index,
            x=found.x_m,
            y=found.y_m,
            yaw_deg=float(np.rad2deg(found.yaw_rad)),
            up_by=up_by,
            map_epoch=self._mode.map_epoch,
        )


def _is_in_map(result: TrackResult) -> bool:
    return result.status == "tracked" and result.fragment == 0


def _is_there(result: TrackResult, near: Whereabouts) -> bool:
    return _is_in_map(result) and near.has(result.T_world_cam)


def _not_there(at: FloorPose, result: TrackResult, frames: FloorFrames) -> str:
    text = f"locate: not found at {_text(at)}: the camera"
    if _is_in_map(result):
        return f"{text} is tracked at {_text(frames.pose_of(result.T_world_cam))}"
    return f"{text} is lost: expected a pose within 0.5 m and 30 degrees where keyframes show what it sees"


def _far_from_all(at: FloorPose, frames: FloorFrames, known: np.ndarray) -> str:
    poses = np.array([(pose.x_m, pose.y_m) for pose in map(frames.pose_of, known)])  # [n, 2]
    (low_x, low_y), (high_x, high_y) = poses.min(axis=0), poses.max(axis=0)
    return (
        f"locate: no keyframe near {_text(at)} looks that way: keyframes stand at "
        f"x {low_x:.1f} to {high_x:.1f} m, y {low_y:.1f} to {high_y:.1f} m"
    )


def _text(at: FloorPose) -> str:
    return f"{at.x_m:.2f} {at.y_m:.2f} {np.rad2deg(at.yaw_rad):.0f}"
