"""Keyframes: rows for ever, pixels while they are kept, poses that readers copy without a lock."""

from contextlib import AbstractContextManager

import numpy as np

from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.geometry.camera import Camera, camera_difference
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.keyframes.header import COUNT, INHERITED
from hsslam_node.map.keyframes.poses import KeyframePoses
from hsslam_node.map.keyframes.room import KeyframeRoom
from hsslam_node.map.keyframes.rows import KeyframeRows
from hsslam_node.map.keyframes.slots import KeyframeSlots
from hsslam_node.map.keyframes.staged import StagedKeyframes
from hsslam_node.map.keyframes.world_frame import LEVEL, WorldFrame
from hsslam_node.map.memory_order import load_ordered, store_ordered
from hsslam_node.map.pose_correction import PoseCorrection

_SURE = np.zeros((6, 6))


class RetiredKeyframeError(Exception):
    """The pixels of the keyframe are not kept any more."""


class KeyframeStore:
    """Append-only keyframes over named arrays.

    A keyframe is *kept* while it has its pixels. The mapper retires those that show nothing of their own:
    their slot is used again, their row stays and moves with another keyframe, its anchor.

    One writer per array: the tracker appends (pixels, row, slot, then the count); the mapper retires
    (anchor, then the slot); bundle adjustment, and mapping where it refines poses, rewrites poses, one at a
    time, into the bank that is not current, then bumps the pose version. They also settle old rows, whose
    anchors they write.
    """

    def __init__(self, arrays: ArrayAllocator) -> None:
        """Attach to a store; KeyError if it does not exist yet."""
        self._header = arrays.open("keyframes")  # [16] int64, see `keyframes/header.py`
        row = arrays.open("keyframe_camera")  # [23] float64: camera, depth scale, level frame
        if load_ordered(row, 0) == 0:  # the width is written last: its maker is still at it
            raise KeyError("keyframe_camera")
        width, height, fx, fy, cx, cy, units = row[:LEVEL]
        self.camera = Camera(int(width), int(height), float(fx), float(fy), float(cx), float(cy))
        self.depth_units_per_m = float(units)
        self.world_frame = WorldFrame(self._header, arrays.open("keyframe_gravity"), row[LEVEL:])
        self._rows = KeyframeRows(arrays)
        self._slots = KeyframeSlots(arrays, self.camera)
        self._poses = KeyframePoses(self._header, self._rows, self._slots)
        self.room = KeyframeRoom(self._header, self._slots)

    @classmethod
    def create(
        cls, arrays: ArrayAllocator, camera: Camera, depth_units_per_m: float, capacity: int
    ) -> "KeyframeStore":
        """Create the arrays, or attach to those that a former process of this run left."""
        arrays.create("keyframes", (16,), np.int64)
        arrays.create("keyframe_gravity", (2, 4), np.float64)
        KeyframeSlots.create_table(arrays, capacity)
        row = arrays.create("keyframe_camera", (23,), np.float64)
        row[1:7] = camera.height_px, camera.fx, camera.fy, camera.cx, camera.cy, depth_units_per_m
        store_ordered(row, 0, camera.width_px)  # last: it says that the row is complete
        return cls(arrays)

    @property
    def count(self) -> int:
        """Keyframes that are complete, the retired ones included."""
        return load_ordered(self._header, COUNT)

    @property
    def pixel_bytes(self) -> int:
        """Memory of the pixels of one keyframe."""
        return self._slots.slot_bytes

    @property
    def pose_version(self) -> int:
        """Grows with every correction by bundle adjustment."""
        return self._poses.version

    @property
    def inherited(self) -> int:
        """Keyframes that come from a saved map: the first ones."""
        return load_ordered(self._header, INHERITED)

    def mark_inherited(self) -> None:
        """Say that the keyframes of now come from a saved map."""
        store_ordered(self._header, INHERITED, self.count)

    def has_room(self, *, has_gap: bool = False) -> bool:
        """The tracker only: whether a keyframe can be appended, with or without a gap before it; counted
        where it cannot."""
        slot, _ = self._slots.reserve(self.count, self.room.most_kept)
        has_room = slot >= 0 and self._rows.reserve(self.count, has_gap)
        if not has_room:
            self.room.refuse()
        return has_room

    def appending(self) -> AbstractContextManager[None]:
        """The tracker only: around reading the pose version and `append`, so that no correction between the
        two misses the keyframe."""
        return self._poses.appending()

    def append(
        self,
        frame: Frame,
        T_world_cam: np.ndarray,
        version: int | None = None,
        covariance: np.ndarray = _SURE,
        gap_covariance: np.ndarray = _SURE,
        fragment: int = 0,
        reference: int | None = None,
    ) -> int:
        """Add a keyframe and return its id; its pose was right at pose version `version`, None: now.

        covariance: [6, 6] of the pose, as in `geometry/pose_covariance.py`.
        gap_covariance: [6, 6] (m, rad; axes of this camera, rotation about its centre) of the motion since
            the keyframe before, as far as only the robot's odometry, the join of a fragment or a place that
            was found again tells it; 0: the camera was aligned all the way.
        fragment: see `fragments`.
        reference: the keyframe from which the pose was taken, None: the one before. A keyframe that comes
            while a correction is computed moves with it.

        Raises:
            UserError: no more can be kept, or the frame's camera or depth scale is not the store's.
            OutOfMemoryError: there is no memory for its pixels, and none of another to be used again.
        """
        k = self.count
        self.expect_like(frame)
        slot, refusal = self._slots.reserve(k, self.room.most_kept)
        if slot < 0:
            full = f"keyframes.capacity = {self.room.capacity}: the run needs more keyframes"
            raise refusal or UserError(full)
        version = self.pose_version if version is None else version
        self._slots.write(slot, frame.color, frame.depth_raw)
        self._rows.write(
            k,
            frame.index,
            frame.stamp_ns,
            slot,
            version,
            T_world_cam,
            covariance,
            gap_covariance,
            fragment,
            k - 1 if reference is None else reference,
        )
        self._slots.take(slot, k)
        store_ordered(self._header, COUNT, k + 1)
        self._slots.drop(k + 1, self.room.most_kept)
        return k

    def staging(self) -> StagedKeyframes:
        """The tracker only: for keyframes that come at once; none is appended otherwise until they have."""
        return StagedKeyframes(self._slots, self._rows, self.count, lambda: self.room.most_kept)

    def append_staged(
        self, staged: StagedKeyframes, T_world_cam: np.ndarray, covariances: np.ndarray,
        gap_covariances: np.ndarray, fragment: int,
    ) -> np.ndarray:  # fmt: skip
        """The tracker only: show n staged keyframes to all processes; returns their ids [n] int64.

        T_world_cam [n, 4, 4], covariances [n, 6, 6], gap_covariances [n, 6, 6]: as in `append`.
        """
        first, n = self.count, len(staged.staged)
        version = self.pose_version
        for k, keyframe in enumerate(staged.staged):
            self._rows.write(
                first + k, keyframe.frame_index, keyframe.stamp_ns, keyframe.slot, version,
                T_world_cam[k], covariances[k], gap_covariances[k], fragment,
                first + k - 1 if k else -1,
            )  # fmt: skip
        store_ordered(self._header, COUNT, first + n)
        return np.arange(first, first + n)

    def forget_incomplete(self) -> None:
        """The tracker only: undo what a former tracker of this run, which died, did not complete."""
        self._slots.forget_incomplete(self.count)
        self.room.want(0)

    def expect_like(self, frame: Frame) -> None:
        """UserError where the frame is not of the store's camera."""
        if difference := camera_difference(frame, self):
            raise UserError(f"frame {frame.index}: {difference} as in the keyframes")

    def retire(self, k: int, anchor: int) -> None:
        """The mapper only: give up the pixels of keyframe k, which moves with `anchor` from now on."""
        slot = self._rows.slot(k)
        if k == anchor or not self._slots.holds(slot, k):
            raise ValueError(f"keyframe {k} is not kept, or its own anchor")
        self._rows.hang(k, anchor)
        self._slots.give_up(slot, self.count)

    def kept(self) -> np.ndarray:
        """Ids of the keyframes that are kept, sorted [m] int64."""
        return self._slots.held(self.count)

    def is_kept(self, k: int) -> bool:
        """Whether keyframe k has its pixels."""
        return self._slots.holds(self._rows.slot(k), k)

    def pixels(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 and raw depth [H, W] uint16 of keyframe k, not copied.

        Raises:
            RetiredKeyframeError: they are not kept.
        """
        slot = self._rows.slot(k)
        if not self._slots.holds(slot, k):
            raise RetiredKeyframeError(f"keyframe {k}")
        return self._slots.pixels(slot)

    def frame(self, k: int) -> Frame:
        """Keyframe k as a frame, copied.

        Raises:
            RetiredKeyframeError: its pixels are not kept, or were given up meanwhile.
        """
        color, depth_raw = (pixels.copy() for pixels in self.pixels(k))
        if not self.is_kept(k):
            raise RetiredKeyframeError(f"keyframe {k}")
        index, stamp_ns = self._rows.identity(k)
        return Frame(index, stamp_ns, self.camera, color, depth_raw, self.depth_units_per_m)

    def frame_indices(self) -> np.ndarray:
        """Frame index of each keyframe, [n] int64."""
        return self._rows.frame_indices(self.count)

    def stamps_ns(self) -> np.ndarray:
        """Sensor stamp of each keyframe, [n] int64 ns."""
        return self._rows.stamps_ns(self.count)

    def fragments(self) -> np.ndarray:
        """The fragment in which the camera was tracked to each keyframe, [n] int64; 0: the map.

        Between two keyframes of different fragments the camera was lost, so their motion is not known.
        """
        return self._rows.fragments(self.count)

    def joined_since(self, first: int, end: int | None = None) -> int:
        """How many of the keyframes from number `first` up to `end` (None: all) came with a fragment that
        joined the map, or were appended after it. A tracker that is restarted goes on as in the map, with
        number 0: this is no join."""
        if not 0 < first < (self.count if end is None else end):
            return 0
        numbers = self.fragments()[:end]
        return int((numbers[first:] > numbers[first - 1]).sum())

    def poses(self) -> np.ndarray:
        """T_world_cam of all keyframes, [n, 4, 4], a consistent copy."""
        return self._poses.all()

    def poses_of(self, ids: np.ndarray) -> np.ndarray:
        """T_world_cam of keyframes `ids` [m], [m, 4, 4], a consistent copy."""
        return self._poses.of(np.asarray(ids, np.int64))

    def pose(self, k: int) -> np.ndarray:
        """T_world_cam of keyframe k, [4, 4]."""
        return self._poses.one(k)[0]

    def pose_at(self, k: int) -> tuple[np.ndarray, int]:
        """T_world_cam of keyframe k, [4, 4], and the pose version that has it."""
        return self._poses.one(k)

    def covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the pose that keyframe k was appended with; 0: it defines the world, or a saved map."""
        return self._rows.covariance(k)

    def gap_covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the motion before keyframe k that was not tracked, as `append` was given it."""
        return self._rows.gap_covariance(k)

    def note_losses(self, ids: np.ndarray, losses: np.ndarray) -> None:
        """Whoever steps the map: the newest rendering losses [n] of keyframes `ids` [n]."""
        self._rows.note_losses(ids, losses)

    def losses(self, ids: np.ndarray) -> np.ndarray:
        """The newest rendering losses of keyframes `ids` [n], [n]; nan where none is known."""
        return self._rows.losses(ids)

    def note_mapped(self, ids: np.ndarray, T_world_cam: np.ndarray, due: np.ndarray) -> None:
        """The mapper only: the poses [n, 4, 4] at which it has seen keyframes `ids` [n], and how many draws
        of each are due [n]. A restarted mapper continues with them."""
        self._rows.note_mapped(ids, T_world_cam, due)

    def mapped(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What `note_mapped` noted of keyframes `ids` [n]: poses [n, 4, 4], 0 if none, and due [n] int64."""
        return self._rows.mapped(ids)

    def correct_poses(
        self,
        ids: np.ndarray,
        T_world_cam: np.ndarray,
        known: int | None = None,
        T_then: np.ndarray | None = None,
    ) -> PoseCorrection:
        """Bundle adjustment and mapping, one at a time: replace the poses [n, 4, 4] of `ids`.

        Retired keyframes move with their anchors. `known`: keyframes there were when the correction was
        computed; those that came since move with their references. `T_then` [n, 4, 4]: poses of `ids` from
        which it was computed; where others have moved them since, both changes count.
        """
        return self._poses.correct(ids, T_world_cam, known, T_then)
