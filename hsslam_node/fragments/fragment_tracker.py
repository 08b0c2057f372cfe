"""Tracks a lost camera in a fragment, until the fragment joins the map."""

from collections.abc import Callable
from dataclasses import replace

from hsslam_node.config import SlamConfig
from hsslam_node.config.tracking import NEW_MAP_AFTER_S
from hsslam_node.fragments.fragment import Fragment, most_keyframes
from hsslam_node.fragments.join_search import JoinSearch
from hsslam_node.fragments.joining import Joining
from hsslam_node.frame import Frame
from hsslam_node.geometry.fragment_place import FragmentPlace
from hsslam_node.map.pose_log import MOST_FRAGMENTS
from hsslam_node.map.store import KeyframeStore
from hsslam_node.place_recognition.image_features import image_features
from hsslam_node.tracking.map_view import MapView
from hsslam_node.tracking.open_tracker import FrameTracker, open_tracker
from hsslam_node.tracking.places.place_near import Whereabouts
from hsslam_node.tracking.tracked_frame import JoinedFragment, TrackResult
from hsslam_node.tracking.tracker import Tracker
from hsslam_node.tracking.tracking_work import TrackingWork

_SEEING_S = 1.0  # time that a lost camera has to relocalise, once images have texture
_FEWEST_FEATURES = 60  # of an image with texture


def open_fragment_tracker(
    config: SlamConfig,
    store: KeyframeStore,
    seed: int,
    threads: int = 1,
    *,
    new_map_after_s: float = NEW_MAP_AFTER_S,
    fragments: int = 0,
    keep: Callable[[Fragment], None] | None = None,
    note_join: Callable[[JoinedFragment], None] | None = None,
) -> FrameTracker:
    """The tracker of a configuration, with fragments if it recognises places.

    Args:
        new_map_after_s: a fragment begins when the camera has been lost for this time; 0: never.
        fragments: number of fragments begun before.
        keep: takes each fragment that ends without a join; None: it is lost.
        note_join: takes each fragment that joins, as `Joining` calls it.
    """
    tracker = open_tracker(config, store, seed, threads)
    if not isinstance(tracker, Tracker) or not new_map_after_s:
        return tracker
    return FragmentTracker(
        config, store, seed, tracker, new_map_after_s, fragments, keep, note_join
    )


class FragmentTracker:
    """Tracks in the map; tracks a camera that has been lost for long in a fragment.

    A pose in a fragment has the status `lost`, and the fragment's number in `fragment`. When the fragment
    joins the map, its keyframes are copied to the map, and tracking continues there. If a frame is lost
    during the join, copying goes on; after it the tracker looks for the camera in the map.
    """

    def __init__(
        self, config: SlamConfig, store: KeyframeStore, seed: int, tracker: Tracker,
        new_map_after_s: float, fragments: int, keep: Callable[[Fragment], None] | None = None,
        note_join: Callable[[JoinedFragment], None] | None = None,
    ) -> None:  # fmt: skip
        self._slam = config
        self._after_ns = round(1e9 * new_map_after_s)
        self._store = store
        self._seed = seed
        self._map = tracker
        self._fragment: Fragment | None = None
        self._search: JoinSearch | None = None
        self._joining: Joining | None = None
        self._begun = fragments
        self._keep = keep
        self._note_join = note_join
        self._lost_ns: int | None = None  # stamp of the first of the lost frames
        # The newest frame, if it was lost in the fragment and the map then raised `TornMapError`: it comes
        # again, and the fragment must not track it twice.
        self._torn: tuple[Frame, TrackResult] | None = None
        self._seeing_ns: int | None = None  # since when the lost frames have texture

    def resume(self, *, anywhere: bool = False) -> None:
        """As the tracker of the map."""
        self._map.resume(anywhere=anywhere)

    def limit_work(self, work: TrackingWork) -> None:
        """As the trackers of map and fragment."""
        self._map.limit_work(work)
        if self._fragment is not None:
            self._fragment.tracker.limit_work(work)

    def prepare_next(self) -> None:
        """As the tracker in use."""
        (self._fragment.tracker if self._fragment else self._map).prepare_next()

    def track(
        self, frame: Frame, view: MapView | None, *, localise_only: bool = False
    ) -> TrackResult:
        """Pose of the frame; see the class.

        Raises:
            TornMapError: as by the tracker of the map.
        """
        if self._fragment is not None and not localise_only:
            return self._in_fragment(self._fragment, frame, view)
        self._leave()
        result = self._map.track(frame, view, localise_only=localise_only)
        if localise_only or self._store.count == 0:
            self._lost_ns = None
            return result
        return self._after(frame, result)

    def finish(self) -> JoinedFragment | None:
        """After the last frame: complete the join if the fragment's place is known; returns the fragment that
        joined, if any."""
        if self._search is not None:
            self._begin_joining(self._search.collect())
        joined = self._joining.finish() if self._joining is not None else None
        if joined is None:
            self._leave()
        self._fragment = self._search = self._joining = None
        return joined

    def find_near(
        self, frame: Frame, view: MapView | None, near: Whereabouts, *, localise_only: bool = False
    ) -> TrackResult | None:
        """As the tracker of the map; a camera that is found leaves its fragment. None while a fragment
        joins the map, unless `localise_only` is set."""
        place = self._search.collect() if self._search is not None else None  # see `_in_fragment`
        if not localise_only:
            self._begin_joining(place)
            if self._joining is not None:
                return None
        found = self._map.find_near(frame, view, near, localise_only=localise_only)
        if found is not None:
            self._leave()
            self._lost_ns = None
        return found

    def _in_fragment(self, fragment: Fragment, frame: Frame, view: MapView | None) -> TrackResult:
        assert self._search is not None
        again, self._torn = self._torn, None
        result = again[1] if again and again[0] is frame else fragment.track(frame)
        is_lost = result.status == "lost"
        if not is_lost:
            self._lost_ns = None
        if self._joining is None:
            # with a lost frame, the map searches: `Relocalisation` takes one call at a time
            self._begin_joining(self._search.collect() if is_lost else self._search.step())
        if self._joining is not None:
            return self._join(fragment, self._joining, frame, result)
        if not is_lost:
            return _of_fragment(result, fragment.number)
        self._torn = frame, result
        found = self._map.track(frame, view)
        self._torn = None
        if found.status != "lost":
            self._leave()
        return self._after(frame, found)

    def _join(
        self, fragment: Fragment, joining: Joining, frame: Frame, result: TrackResult
    ) -> TrackResult:
        """Copy more of the fragment; once all is copied, continue in the map."""
        is_lost = result.status == "lost"
        if not is_lost and (result.status != "tracked" or fragment.tracker.is_bridged):
            # a keyframe must hold the gap of odometry before the join
            return _of_fragment(result, fragment.number)
        joined = joining.step(is_lost=is_lost)
        if joined is not None:
            return self._go_on_in_map(fragment, joined, result)
        if is_lost:
            return self._after(frame, _lost_in_map(result, joining.place))
        return _of_fragment(result, fragment.number)

    def _after(self, frame: Frame, result: TrackResult) -> TrackResult:
        """The result of a frame; if the camera has been lost for long, a fragment begins with this frame."""
        if result.status != "lost":
            self._lost_ns = None
            return result
        if self._lost_ns is None or frame.stamp_ns < self._lost_ns:  # or the clock was set back
            self._lost_ns, self._seeing_ns = frame.stamp_ns, None
        rest_ns = self._lost_ns + self._after_ns - frame.stamp_ns
        if rest_ns > 1e9 * _SEEING_S or self._begun >= MOST_FRAGMENTS:
            return result
        if len(image_features(frame)) < _FEWEST_FEATURES:
            self._seeing_ns = None
            return result
        if self._seeing_ns is None:
            self._seeing_ns = frame.stamp_ns
        if rest_ns > 0 or frame.stamp_ns - self._seeing_ns < 1e9 * _SEEING_S:
            return result
        return self._begin(frame) or result

    def _begin(self, frame: Frame) -> TrackResult | None:
        most = most_keyframes(self._store.pixel_bytes)
        fragment = Fragment(self._slam, frame, self._seed, self._begun + 1, most)
        first = fragment.track(frame)
        if first.status == "lost":  # there is too little depth
            return None
        self._begun, self._lost_ns = fragment.number, None
        self._leave()
        self._fragment = fragment
        self._search = JoinSearch(self._store, self._map.places, fragment)
        return _of_fragment(first, fragment.number)

    def _begin_joining(self, place: FragmentPlace | None) -> None:
        """Begin to join the fragment if its place is known and it does not join yet."""
        if place is not None and self._joining is None and self._fragment is not None:
            self._joining = Joining(self._fragment, self._store, place, self._note_join)

    def _go_on_in_map(
        self, fragment: Fragment, joined: JoinedFragment, result: TrackResult
    ) -> TrackResult:
        """Continue in the map; returns the result of the frame there, lost if it was lost in the fragment."""
        self._map.take_over(fragment.tracker, joined)
        self._fragment = self._search = self._joining = None
        k = int(joined.keyframes[result.keyframe])
        T_keyframe_cam = joined.T_keyframe_own[result.keyframe] @ result.T_keyframe_cam
        covariance = result.covariance
        if covariance is not None:
            covariance = joined.place.covariance(covariance, result.T_world_cam)
        return replace(
            result, covariance=covariance, T_world_cam=self._store.pose(k) @ T_keyframe_cam, keyframe=k,
            T_keyframe_cam=T_keyframe_cam, pose_version=self._store.pose_version, is_carried=True,
            joined=joined,
        )  # fmt: skip

    def _leave(self) -> None:
        """Leave the fragment, if any, without a join, and let it be kept."""
        if self._search is not None:
            self._search.collect()
        self._give_up_joining()
        fragment, self._fragment, self._search = self._fragment, None, None
        if fragment is not None and self._keep is not None:
            self._keep(fragment)

    def _give_up_joining(self) -> None:
        """Give up the join, before other keyframes are appended to the map."""
        if self._joining is not None:
            self._joining.give_up()
        self._joining = None


def _lost_in_map(result: TrackResult, place: FragmentPlace) -> TrackResult:
    """A frame that is lost in a fragment at `place`, which the map does not have yet."""
    lost = TrackResult.without_map(result.frame_index)
    return replace(lost, T_world_cam=place.T_map_fragment @ result.T_world_cam)


def _of_fragment(result: TrackResult, number: int) -> TrackResult:
    return replace(
        result, status="lost", fragment=number, is_reckoned=result.status == "dead_reckoned",
        is_keyframe=False, pose_version=0, covariance=None,
    )  # fmt: skip
