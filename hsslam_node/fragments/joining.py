"""Joins a fragment to the map: copies pixels of a few keyframes with each frame, then shows all at once."""

from collections.abc import Callable

import numpy as np

from hsslam_node.errors import OutOfMemoryError
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.geometry.pose_covariance import UNTRACKED
from hsslam_node.map.gap_covariances import gap_covariances
from hsslam_node.map.store import KeyframeStore
from hsslam_node.tracking.tracked_frame import JoinedFragment

_AT_ONCE = 2  # keyframes copied with each frame, 7 ms each at 640x480
_WHILE_LOST = (
    8  # with a lost frame: the sooner all are in the map, the sooner it can find the camera
)
_SPARE = 16  # free keyframes that a join leaves to the camera, at most a quarter of them
_PARTS = 3  # for a fragment the mapper frees at most one part in three of the map's keyframes


class Joining:
    """Copies the keyframes of a fragment into the map's store while the camera is tracked in the fragment.

    If the map has too little room for them, the mapper first retires keyframes of the map.
    """

    def __init__(
        self,
        fragment: Fragment,
        store: KeyframeStore,
        place: FragmentPlace,
        note: Callable[[JoinedFragment], None] | None = None,
    ) -> None:
        """`note` takes the joined fragment before any process sees its keyframes in the map; with
        OutOfMemoryError they are not shown."""
        self.place = place
        self._note = note
        self._fragment = fragment
        self._store = store
        self._every = 0  # one keyframe in this number is copied; 0: wait for room
        self._staging = store.staging()
        self._ids: list[int] = []  # ids in the fragment of the staged keyframes
        self._next = 0

    def step(self, *, is_lost: bool = False) -> JoinedFragment | None:
        """Copy a few more keyframes; once all are copied, show them and return the joined fragment.

        None before that. None also if the map has memory for none of them, then copying starts again; and if
        there is no memory to note the join, which the next step then tries again.
        `is_lost`: the camera is lost, so more are copied.
        """
        if not self._every and not self._begins(_SPARE):
            return None
        for _ in range(_WHILE_LOST if is_lost else _AT_ONCE):
            if self._next >= self._fragment.store.count:
                return self._show()
            self._copy_next()
        return None

    def finish(self) -> JoinedFragment | None:
        """Copy the other keyframes and show all; None if there is too little room for the fragment."""
        if not self._every and not self._begins(spare=0):
            return None
        while self._next < self._fragment.store.count:
            self._copy_next()
        return self._show()

    def give_up(self) -> None:
        """Discard the copied keyframes and no longer ask for room."""
        self._store.room.want(0)
        self._staging.give_up()

    def _begins(self, spare: int) -> bool:
        """Whether there is room now, `spare` left to the camera; if not, ask the mapper for it."""
        free, kept = self._store.room.free, len(self._fragment.store.kept())
        wanted = min(kept + spare, self._store.room.most_kept // _PARTS)
        if free < wanted:
            self._store.room.want(wanted)
            return False
        self._begin(free - min(spare, free // 4))
        return True

    def _begin(self, room: int) -> None:
        """Copy as many keyframes as `room`; if the fragment keeps more, leave some out evenly."""
        self._store.room.want(0)
        self._every = -(-len(self._fragment.store.kept()) // max(room, 1))

    def _copy_next(self) -> None:
        store, every = self._fragment.store, self._every
        kept = store.kept()
        left = kept[kept >= self._next]  # not empty: the newest keyframe is kept
        k = int(left[0])
        # without room, it moves with the keyframe before it, as retired ones do
        if self._staging.add(store.frame(k)):
            self._ids.append(k)
        if every < len(left):
            self._next = int(left[every])
        elif any(store.gap_covariance(j).any() for j in range(k + 1, store.count)):
            self._next = int(left[-1])  # else the map would not know of the gap
        else:
            self._next = store.count + every - len(left)

    def _show(self) -> JoinedFragment | None:
        own, ids = self._fragment.store, self._ids
        if not ids:
            self._next = 0
            return None
        poses = own.poses()
        gaps = gap_covariances(own, np.array(ids))
        gaps[0] = UNTRACKED
        shown = self._store.count + np.arange(len(ids))
        joined = _joined(self._fragment.number, self.place, np.array(ids), shown, poses)
        if self._note is not None:
            try:
                self._note(joined)
            except OutOfMemoryError:
                return None
        with self._store.appending():
            self._store.append_staged(
                self._staging, self.place.T_map_fragment @ poses[ids],
                np.stack([self.place.covariance(own.covariance(k), poses[k]) for k in ids]), gaps,
                self._fragment.number,
            )  # fmt: skip
        return joined


def _joined(
    fragment: int, place: FragmentPlace, ids: np.ndarray, shown: np.ndarray, poses: np.ndarray
) -> JoinedFragment:
    """The joined fragment: keyframes `ids` [m] have the ids `shown` [m] in the map; the others move with the
    last of these before them. poses: [n, 4, 4] of all."""
    at = np.searchsorted(ids, np.arange(len(poses)), side="right") - 1
    at = np.clip(at, 0, None)
    T_fragment_keyframe = poses[ids[at]]
    T_keyframe_own = np.linalg.inv(T_fragment_keyframe) @ poses
    T_keyframe_own[ids] = np.eye(4)
    return JoinedFragment(fragment, place, shown[at], T_keyframe_own, T_fragment_keyframe)
