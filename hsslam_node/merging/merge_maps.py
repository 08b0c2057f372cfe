"""Merges two saved maps of one place whose worlds have no known relation."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import same_depth_scale
from hsslam_node.geometry.pose_covariance import UNTRACKED
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.checkpoint import MapCheckpoint, load_checkpoint
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.restore import restore_map, saved_frames
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.mapper import Mapper
from hsslam_node.merging.joined_graph import JoinedGraph
from hsslam_node.merging.meetings import (
    CLEARLY,
    FEWEST_BLOCKS,
    FEWEST_PLACES,
    Meeting,
    agreeing,
    elsewhere,
    find_meetings,
    is_clear,
    keyframes_in,
    pictures_of,
    places_apart,
    second_best,
    show_the_same,
)
from hsslam_node.place_recognition.picture_agreement import ALIKE_SHARE
from hsslam_node.presets import REALTIME
from hsslam_node.progress import Track, silently


@dataclass(frozen=True)
class JoinedMap:
    """The merged map, in the world of the first; the keyframes of the second come last, those that show only
    what the first shows retired."""

    config: SlamConfig
    store: KeyframeStore
    parameters: FieldParameters  # published
    parts: tuple[Trajectory, Trajectory]  # the keyframes of both as saved, own worlds
    meetings: tuple[Meeting, ...]  # that the pose graph confirms
    places: int  # number of places that they show

    @property
    def seam(self) -> int:
        """Id of the first keyframe of the second map."""
        return len(self.parts[0])

    @property
    def T_first_second(self) -> np.ndarray:
        """[4, 4], from the second world to the first, by the keyframe of the best meeting."""
        k = self.meetings[0].second
        return self.store.pose(self.seam + k) @ inverse(self.parts[1].T_world_cam[k])


def merge_maps(
    arrays: ArrayAllocator,
    first: Path,
    second: Path,
    seed: int = 0,
    device: Device = CPU,
    track: Track = silently,
) -> JoinedMap:
    """Find where the maps of two files meet, solve for all keyframes, retire those of the second that show
    only what the first shows, and fit the field of the first to the others. Each may be of a fragment
    (`fragment_map`).

    The configuration is preset `realtime`, but with the field and the sampling of the first map, and with the
    smaller of both maps' limits of depth.

    Raises:
        UserError: a map cannot be used (`restore_map`), they are of different cameras, or they do not meet
            in three places that agree, or what they show there differs in detail, or they meet in more
            than one way.
        OutOfMemoryError: there is no room for the arrays.
    """
    saved, other = load_checkpoint(first), load_checkpoint(second)
    _expect_same_camera(first, saved, second, other)
    seam, count = (len(s.keyframe_stamps_ns) for s in (saved, other))
    config = replace(
        REALTIME,
        field=saved.layout.config,
        sampling=saved.sampling or REALTIME.sampling,
        mapper=replace(REALTIME.mapper, max_depth_m=_max_depth_m(saved, other)),
        keyframes=replace(REALTIME.keyframes, capacity=seam + count + 1),
    )
    store, parameters = restore_map(arrays, first, config, may_be_fragment=True)
    frames = track(saved_frames(second, other), count, description="places")
    poses = other.T_world_keyframe
    found = find_meetings(store, frames, poses, config.tracker, seed)
    meetings = agreeing(found)
    _expect_places(first, second, meetings)
    _expect_same_pictures(first, second, meetings)
    T_worlds = meetings[0].T_worlds
    _expect_one_way(first, second, meetings, second_best(elsewhere(found, T_worlds), meetings))
    T_placed = T_worlds @ poses
    for k, frame in enumerate(saved_frames(second, other)):
        gap = other.gap_covariance(k) if k else UNTRACKED
        store.append(frame, T_placed[k], gap_covariance=gap)
    solved, meetings = JoinedGraph(store, seam, config, seed).solve(meetings, track)
    places = _expect_places(first, second, meetings)
    store.correct_poses(np.arange(len(solved)), solved)
    first_iterations = 0 if saved.is_fitted else config.mapper.first_iterations
    mapper = Mapper(config, parameters, seed, device)
    while mapper.select_last(store):
        pass
    new = len(store.kept()) - (seam if saved.is_fitted else 0)
    iterations = first_iterations + config.mapper.iterations * new
    _refit(mapper, store, iterations, track)
    parts = (
        Trajectory(saved.keyframe_stamps_ns, saved.T_world_keyframe),
        Trajectory(other.keyframe_stamps_ns, poses),
    )
    joined = JoinedMap(config, store, parameters, parts, tuple(meetings), places)
    if other.T_level_world is not None:
        store.world_frame.note_level(other.T_level_world @ inverse(joined.T_first_second))
    if store.world_frame.gravity is None and other.gravity is not None:
        store.world_frame.note_gravity(other.gravity.turned(joined.T_first_second[:3, :3]))
    return joined


def _max_depth_m(*maps: MapCheckpoint) -> float:
    """The smallest of their limits: what lies beyond one of them was not meant to be mapped."""
    limits = [one.max_depth_m for one in maps if one.max_depth_m is not None]
    return min(limits, default=REALTIME.mapper.max_depth_m)


def _refit(mapper: Mapper, store: KeyframeStore, iterations: int, track: Track) -> None:
    """Fit the map: this many iterations, then a run's last iterations."""
    mapper.grow_bound(store)
    last = mapper.last_iterations(store)
    for k in track(range(iterations + last), description="map"):
        mapper.refine_sparse(store, max(k - iterations, 0) / max(last, 1))
    mapper.publish()


def _expect_places(first: Path, second: Path, meetings: Sequence[Meeting]) -> int:
    """Number of places that agree; UserError if there are too few."""
    places = places_apart(meetings)
    if places < FEWEST_PLACES:
        raise UserError(
            f"{second}: has {places} places in common with {first}: expected {FEWEST_PLACES} or "
            "more, 1 m apart or farther"
        )
    return places


def _expect_same_pictures(first: Path, second: Path, meetings: Sequence[Meeting]) -> None:
    """UserError if the places that agree only look alike."""
    if not show_the_same(meetings):
        pictures = pictures_of(meetings)
        raise UserError(
            f"{second}: {pictures.alike} of {pictures.compared} image blocks of common places show what "
            f"{first} shows: expected {ALIKE_SHARE:.0%} or more, of {FEWEST_BLOCKS} blocks or more"
        )


def _expect_one_way(
    first: Path, second: Path, best: Sequence[Meeting], other: Sequence[Meeting]
) -> None:
    """UserError if keyframes support another pose between the maps nearly as well."""
    if not is_clear(best, other):
        raise UserError(
            f"{second}: meets {first} in more than one way: {keyframes_in(best)} keyframes agree on one "
            f"pose, {keyframes_in(other)} on another: expected {CLEARLY} times as many or more on one"
        )


def _expect_same_camera(
    first: Path, saved: MapCheckpoint, second: Path, other: MapCheckpoint
) -> None:
    """UserError if the maps have different cameras or depth scales; a map without them passes."""
    here, there = saved.camera, other.camera
    if here is None or there is None or saved.images is None or other.images is None:
        return  # an old map, which is refused later with a better reason
    if difference := there.differs_in(here):
        name, value, expected = difference
        what = value if name == "size" else f"{name} is {value} px"
        raise UserError(f"{second}: {what}: expected {expected}, as in {first}")
    expected, value = (s.images.depth_units_per_m for s in (saved, other) if s.images)
    if not same_depth_scale(value, expected):
        raise UserError(
            f"{second}: {value:.9g} depth units per metre: expected {expected:.9g}, as in {first}"
        )
