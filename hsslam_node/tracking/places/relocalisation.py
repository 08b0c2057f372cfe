"""Relocalisation: finds the pose of a lost camera by keyframes that look the same, a few a frame."""

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from hsslam_node.config import TrackerConfig
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.geometry.view_distance import view_distance
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.place_recognition.image_features import ImageFeatures, image_features
from hsslam_node.place_recognition.keyframe_index import KeyframeIndex
from hsslam_node.place_recognition.picture_agreement import PictureAgreement, picture_agreement
from hsslam_node.tracking.find_loop import LoopLimits, LoopMatch, find_loop
from hsslam_node.tracking.keyframes.covering_keyframe import covering_keyframe
from hsslam_node.tracking.keyframes.reference_keyframe import ReferenceKeyframe, stored_reference
from hsslam_node.tracking.places.place_near import Whereabouts, place_near

_CANDIDATES = 2  # keyframes compared with a lost frame, about 35 ms each
_INDEXED_WHEN_LOST = 2  # keyframes indexed with a lost frame, about 15 ms each
_INDEXED_BESIDE = 4  # keyframes indexed with a frame that the thread compares
_OBSERVED_EVERY = 8  # frames; by then the thread has long been done
_LIMITS = LoopLimits(overlap=0.2)
_APART_M, _APART_RAD = 0.1, 0.087  # between two places that are not the same
_CLEARLY = 2.0  # times the inliers of a match at another place
_T = TypeVar("_T")


@dataclass(frozen=True)
class Place:
    """A guess for a lost camera, with a keyframe to align it to."""

    T_world_cam: np.ndarray  # [4, 4]
    reference: ReferenceKeyframe


@dataclass(frozen=True)
class SeenAgain:
    """A keyframe that shows the same place as a frame, and how far the two agree in detail."""

    match: LoopMatch
    pictures: PictureAgreement


class Relocalisation:
    """Indexes the keyframes of a store, and finds the place of a lost frame in the index.

    While the camera is tracked, a thread indexes keyframes with a new view (15 ms each, about one frame in
    thirty). While it is lost, only a few are indexed with each frame, so that tracking keeps up with the
    sensor.
    """

    def __init__(self, config: TrackerConfig, store: KeyframeStore, seed: int) -> None:
        self._config = config
        self._store = store
        self._seed = seed
        self._index = KeyframeIndex(store)
        self._frames = 0
        self._thread = _new_thread()
        self._pending: tuple[int, Future[ImageFeatures]] | None = None

    def observe(self) -> None:
        """Take a tracked frame: every few frames, begin to index a keyframe with a new view."""
        self._frames += 1
        if self._frames % _OBSERVED_EVERY:
            return
        self._index_pending()
        k = self._index.next_new()
        if k is not None:
            with contextlib.suppress(RetiredKeyframeError):  # meanwhile
                frame = self._store.frame(k)
                self._pending = k, self._soon(lambda: image_features(frame))

    def observe_all(self) -> None:
        """Index all keyframes, before the first frame of a camera that may be anywhere."""
        self._index.update()

    def places(self, frame: Frame, *, may_look_alike: bool = True) -> Iterator[Place]:
        """The place of a lost frame, by current keyframe poses: at most one, none if it is ambiguous.

        The whole images agree (`find_loop`). A keyframe of another place that agrees nearly as well makes
        the place ambiguous. If the frame may show a place that only looks alike, the images must also agree
        in detail.
        """
        self._index_pending()
        # after a restart the index is empty, and the camera was last near the newest keyframes
        self._index.update(_INDEXED_WHEN_LOST, newest_first=True)
        matches = find_loop(
            self._store, self._index, frame, self._config,
            candidates=_CANDIDATES, limits=_LIMITS, seed=self._seed,
        )  # fmt: skip
        T_world_cam = [self._store.pose(m.keyframe) @ m.T_keyframe_cam for m in matches]
        if not matches or not _is_clear(matches, T_world_cam):
            return
        if may_look_alike and self._differs(matches[0], frame):
            return
        if (place := self._place(frame, T_world_cam[0])) is not None:
            yield place

    def place_near(self, frame: Frame, near: Whereabouts) -> Place | None:
        """The place of a frame near a place that a person names; see `place_near`."""
        self._index_pending()
        T_world_cam = place_near(
            self._store, self._index, frame, near, self._config, _LIMITS, self._seed
        )
        return None if T_world_cam is None else self._place(frame, T_world_cam)

    def _differs(self, match: LoopMatch, frame: Frame) -> bool:
        """Whether the keyframe of a match shows another place that only looks like the frame's."""
        try:
            keyframe = self._store.frame(match.keyframe)
        except RetiredKeyframeError:  # meanwhile: the next frame finds another
            return True
        return picture_agreement(keyframe, frame, match.T_keyframe_cam).differ

    def _place(self, frame: Frame, T_world_cam: np.ndarray) -> Place | None:
        """The place at a pose, with a keyframe that shows what the frame shows: the nearest may have depth
        in few pixels, as something that moved covered its view."""
        try:
            k = covering_keyframe(self._store, frame, T_world_cam, self._nearest(T_world_cam))
            return Place(T_world_cam, stored_reference(self._store, k, self._config))
        except RetiredKeyframeError:  # meanwhile: the next frame finds another
            return None

    def compare(self, frame: Frame) -> Future[list[SeenAgain]]:
        """Begin to compare a frame with the keyframes, in the thread. Until the result is there, call no
        other method of this object, and append no keyframes."""
        self._index_pending()
        return self._soon(lambda: self._compared(frame))

    def _soon(self, work: Callable[[], _T]) -> Future[_T]:
        """Begin work in the thread; without a thread to start, it is done at once."""
        try:
            return self._thread.submit(work)
        except RuntimeError:  # this machine has no thread left
            self._thread = _new_thread()  # the old one would do the work later
        done: Future[_T] = Future()
        done.set_result(work())
        return done

    def _compared(self, frame: Frame) -> list[SeenAgain]:
        self._index.update(_INDEXED_BESIDE, newest_first=True)
        found = []
        for match in find_loop(self._store, self._index, frame, self._config, seed=self._seed):
            with contextlib.suppress(RetiredKeyframeError):  # meanwhile
                keyframe = self._store.frame(match.keyframe)
                pictures = picture_agreement(keyframe, frame, match.T_keyframe_cam)
                found.append(SeenAgain(match, pictures))
        return found

    def _index_pending(self) -> None:
        """Wait for the keyframe of the thread and index it, so that every run does it at the same frame."""
        if self._pending is not None:
            k, features = self._pending
            self._pending = None
            self._index.take(k, features.result())

    def _nearest(self, T_world_cam: np.ndarray) -> int:
        """The kept keyframe with the nearest view, the oldest of equals."""
        ids = self._store.kept()
        return int(ids[np.argmin(view_distance(T_world_cam, self._store.poses_of(ids)))])


def _is_clear(matches: list[LoopMatch], T_world_cam: list[np.ndarray]) -> bool:
    """Whether the first match, the best, has far more inliers than any match at another place."""
    for match, T in zip(matches[1:], T_world_cam[1:], strict=True):
        step = inverse(T_world_cam[0]) @ T
        apart = (
            np.linalg.norm(step[:3, 3]) > _APART_M
            or np.linalg.norm(so3_log(step[:3, :3])) > _APART_RAD
        )
        if apart and matches[0].inliers < _CLEARLY * match.inliers:
            return False
    return True


def _new_thread() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, "features", _lower_priority)


def _lower_priority() -> None:
    if sys.platform == "linux":  # on other systems, nice applies to the whole process
        os.nice(10)
