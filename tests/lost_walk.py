"""A walk in the built-in room with a covered lens: a fragment begins, and joins the map on the way back."""

from functools import cache

import numpy as np

from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.fragments.fragment import Fragment
from hsslam_node.fragments.fragment_tracker import open_fragment_tracker
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

DARK = range(30, 48)  # 3.6 s
DRIFT_M, DRIFT_DEG = 0.15, 3.0  # of a fragment, before bundle adjustment
_OPTIONS = SourceOptions(
    stride=6, cover_at=DARK.start, cover_frames=len(DARK), to_and_fro=2, frames=206,
    synth=SynthOptions(width_px=160, height_px=120),
)  # fmt: skip


@cache
def walk() -> tuple[tuple[Frame, ...], np.ndarray]:
    """Once round the room and most of the way back, and the true poses relative to the first."""
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
    keep = [].append if kept is None else kept.append
    return open_fragment_tracker(SMALL, store, 0, new_map_after_s=new_map_after_s, keep=keep), store


@cache
def lost_and_joined() -> tuple[list[TrackResult], KeyframeStore, list[int]]:
    """Results, the store, and how many keyframes it had after each frame."""
    tracker, store = opened(3.0)
    results, counts = [], []
    for frame in walk()[0]:
        results.append(tracker.track(frame, None))
        counts.append(store.count)
    return results, store, counts


def until_it_is_copied(
    kept: list[Fragment] | None = None, before: int = 3
) -> tuple[FrameTracker, KeyframeStore, int]:
    """Three frames (`before`) before the fragment joins the map, and the frame after them; `kept` as in
    `opened`."""
    results, _, _ = lost_and_joined()
    end = next(k for k, r in enumerate(results) if r.joined) - before
    tracker, store = opened(3.0, kept)
    for frame in walk()[0][:end]:
        tracker.track(frame, None)
    return tracker, store, end
