"""Two sessions in the built-in room, each in a world of its own; in its mirror image; in a room like it."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from hsslam_node.dense_map.snapshot import map_snapshot
from hsslam_node.evaluation.ground_truth import open_ground_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.geometry.trajectory import Trajectory, write_tum
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.checkpoint import save_checkpoint
from hsslam_node.map.layout import FieldLayout
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.bound import initial_bound
from hsslam_node.merging.meetings import Meeting, agreeing, find_meetings
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from tests.other_pictures import with_other_pictures
from tests.small_room import SMALL

FIRST, SECOND = slice(0, None, 2), slice(1, None, 2)
"""Rows of the two sessions."""
_KEYFRAMES = 16
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@cache
def walk() -> tuple[tuple[Frame, ...], np.ndarray]:
    """Sixteen frames of 160 x 120 on the way through the room, and their true poses [16, 4, 4]."""
    synth = SynthOptions(width_px=160, height_px=120)
    options = SourceOptions(frames=_KEYFRAMES, stride=12, synth=synth)
    source, truth = open_source("synth:room", options), open_ground_truth("synth:room", options)
    assert truth
    return tuple(f for f in source.frames() if isinstance(f, Frame)), truth.T_world_cam


def in_mirror(frames: tuple[Frame, ...]) -> tuple[Frame, ...]:
    """The frames of a camera in the mirror image of the place: nothing of it lies as in the place."""
    return tuple(
        replace(f, color=f.color[:, ::-1].copy(), depth_raw=f.depth_raw[:, ::-1].copy())
        for f in frames
    )


def session(
    rows: slice, *, mirrored: bool = False, lookalike: bool = False
) -> tuple[KeyframeStore, FieldParameters]:
    """Keyframes of these rows at their true poses, the first in the origin, and a map of no training."""
    all_frames, all_poses = walk()
    frames, poses = all_frames[rows], inverse(all_poses[rows][0]) @ all_poses[rows]
    if mirrored:
        frames, poses = in_mirror(frames), _MIRROR @ poses @ _MIRROR
    if lookalike:
        frames = tuple(with_other_pictures(f) for f in frames)
    arrays, first = MemoryAllocator(), frames[0]
    store = KeyframeStore.create(arrays, first.camera, first.depth_units_per_m, 128)
    for frame, T in zip(frames, poses, strict=True):
        store.append(frame, T)
    bound = initial_bound(first, SMALL.bound, SMALL.mapper.max_depth_m)
    parameters = FieldParameters.create(arrays, FieldLayout.over(SMALL.field, bound), 0)
    parameters.publish()
    return store, parameters


@cache
def meetings() -> tuple[Meeting, ...]:
    """Where the sessions meet, those that agree."""
    (first, _), (second, _) = session(FIRST), session(SECOND)
    frames = walk()[0][SECOND]
    return tuple(agreeing(find_meetings(first, frames, second.poses(), SMALL.tracker)))


def saved_session(
    folder: Path, rows: slice, *, mirrored: bool = False, lookalike: bool = False,
    level: np.ndarray | None = None, gravity: Gravity | None = None,
    max_depth_m: float = SMALL.mapper.max_depth_m,
) -> Path:  # fmt: skip
    """The folder of a run with this session: its map, of a robot with this level frame and gravity, and with
    this limit of depth, and its trajectory."""
    store, parameters = session(rows, mirrored=mirrored, lookalike=lookalike)
    store.world_frame.note_level(level)
    if gravity is not None:
        store.world_frame.note_gravity(gravity)
    folder.mkdir()
    config = replace(SMALL, mapper=replace(SMALL.mapper, max_depth_m=max_depth_m))
    save_checkpoint(folder / "map.safetensors", map_snapshot(store, parameters, config))
    write_tum(folder / "trajectory.txt", Trajectory(store.stamps_ns(), store.poses()))
    return folder
