"""A walk in the built-in room with a covered lens: a fragment begins, and joins the map on the way back."""

import io
import pickle
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cache

import numpy as np

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_tracker import FragmentTracker, open_fragment_tracker
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.tracking.open_tracker import FrameTracker
from hsslam_node.tracking.tracked_frame import TrackResult
from tests.small_room import SMALL

DARK = range(25, 43)  # 3.6 s
DRIFT_M, DRIFT_DEG = 0.15, 3.0  # of a fragment, before bundle adjustment
_SAVED = 100  # number of a frame before the fragment's place in the map is known
_OPTIONS = SourceOptions(
    start=240, stride=6, cover_at=DARK.start, cover_frames=len(DARK), to_and_fro=3, frames=146,
    synth=SynthOptions(width_px=160, height_px=120),
)  # fmt: skip


@cache
def walk() -> tuple[tuple[Frame, ...], np.ndarray]:
    """Half round the room, back, and a part of it again; and the true poses relative to the first."""
    source, truth = open_source("synth:room", _OPTIONS), open_ground_truth("synth:room", _OPTIONS)
    assert truth
    frames = tuple(f for f in source.frames() if isinstance(f, Frame))
    return frames, inverse(truth.T_world_cam[0]) @ truth.T_world_cam


def opened(
    new_map_after_s: float, kept: list[Fragment] | None = None
) -> tuple[FrameTracker, KeyframeStore]:
    """A tracker and its store; it appends fragments that end without a join to `kept`."""
    first = walk()[0][0]
    store = KeyframeStore.create(MemoryAllocator(), first.camera, first.depth_units_per_m, 256)
    keep = None if kept is None else kept.append
    tracker = open_fragment_tracker(SMALL, store, 0, new_map_after_s=new_map_after_s, keep=keep)
    return tracker, store


@cache
def lost_and_joined() -> tuple[list[TrackResult], KeyframeStore, list[int]]:
    """Results, the store, and how many keyframes it had after each frame."""
    results, store, counts, _ = _walked()
    return results, store, counts


def until_it_is_copied(
    kept: list[Fragment] | None = None, before: int = 3
) -> tuple[FragmentTracker, KeyframeStore, int]:
    """Three frames (`before`, at most 20) before the fragment joins the map, and the frame after them;
    `kept` as in `opened`."""
    results, _, _, saved = _walked()
    end = next(k for k, r in enumerate(results) if r.joined) - before
    tracker, store = pickle.loads(saved)
    tracker._keep = None if kept is None else kept.append
    assert end >= _SAVED
    for frame in walk()[0][_SAVED:end]:
        tracker.track(frame, None)
    return tracker, store, end


@cache
def _walked() -> tuple[list[TrackResult], KeyframeStore, list[int], bytes]:
    """As `lost_and_joined`, and the tracker with its store before frame `_SAVED`, to go on from there."""
    tracker, store = opened(3.0)
    results, counts, saved = [], [], b""
    for k, frame in enumerate(walk()[0]):
        if k == _SAVED:
            saved = _saved(tracker, store)
        results.append(tracker.track(frame, None))
        counts.append(store.count)
    return results, store, counts, saved


def _saved(tracker: FrameTracker, store: KeyframeStore) -> bytes:
    assert isinstance(tracker, FragmentTracker) and tracker._fragment is not None
    for each in (tracker._map, tracker._fragment.tracker):
        each.prepare_next()
        each.places._thread.submit(int).result()  # its thread has done all work
    file = io.BytesIO()
    _Pickler(file).dump((tracker, store))
    return file.getvalue()


class _Pickler(pickle.Pickler):
    """Saves a tracker whose threads have no work."""

    def reducer_override(self, thing: object) -> object:
        if isinstance(thing, ThreadPoolExecutor):
            return ThreadPoolExecutor, (1,)
        return (_done, (thing.result(),)) if isinstance(thing, Future) else NotImplemented


def _done(result: object) -> Future:
    future: Future = Future()
    future.set_result(result)
    return future
