"""Measures how long a carried-off chair stays in grid, distances and mesh; prints JSON.

`python -m hsslam_bench.free_space.moved SEED [--noise kinect] [--poses tracked|true]` tracks and maps
`synth:chair` in lockstep; a rolling window takes a frame at its tracked pose ten times a second of frame
time, as the service does. The time runs from the frame by which all of the chair's former place has been
seen through, to the first update in which that place is free. At the end it counts the vertices of the mesh
in that place. With `--poses true` there is neither tracking nor mesh.
"""

import argparse
import json
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from hsslam_bench.field_error.true_frames import TrueFrame, true_frames
from hsslam_bench.free_space.former_place import FormerPlace
from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.distance.distance_meter import DistanceMeter
from hsslam_node.distance.grid_map import grid_map
from hsslam_node.distance.rolling_window import RollingWindow
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.presets import PRESETS
from hsslam_node.slam import Slam
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.scenes.carried_off import CarriedOff
from hsslam_node.synth.scenes.scenes import SCENES

_SPEC = "synth:chair"
_EVERY_S, _EARLY_S = 0.1, 0.005
_KEYFRAME_EVERY, _MOST_KEYFRAMES = 4, 512
_VOXEL_M = 0.02  # of the mesh

Track = Callable[[TrueFrame], tuple[KeyframeStore, np.ndarray, int]]
"""Takes a frame; returns the keyframes, T_world_cam [4, 4], and the frame's reference keyframe."""


@dataclass(frozen=True)
class Freed:
    """Frame time from seeing through the place until it was free, s (None: never free), and whether it was
    occupied before."""

    grid_s: float | None
    distances_s: float | None
    was_occupied: bool


def main() -> None:
    parser = argparse.ArgumentParser(prog="free_space.moved", description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("--noise", choices=("none", "kinect"), default="none")
    parser.add_argument("--poses", choices=("tracked", "true"), default="tracked")
    parser.add_argument("--quick", action="store_true", help="every third frame, small")
    arguments = parser.parse_args()
    synth = SynthOptions(width_px=160, height_px=120) if arguments.quick else SynthOptions()
    stride = 3 if arguments.quick else 1
    seed = arguments.seed
    options = SourceOptions(noise=arguments.noise, seed=seed, synth=synth, stride=stride)
    torch.set_num_threads(1)
    found: dict[str, object] = {}
    if arguments.poses == "true":
        found.update(vars(freed(options, true_poses())))
    else:
        slam = Slam(PRESETS["realtime"], seed=seed)
        found.update(vars(freed(options, tracked_poses(slam))))
        slam.finish()
        vertices = np.asarray(slam.mesh(_VOXEL_M).vertices)
        found["vertices_left"] = place_and_thing(options)[0].count_inside(vertices)
        found["vertices"] = len(vertices)
    print(json.dumps(found))


def place_and_thing(options: SourceOptions) -> tuple[FormerPlace, CarriedOff]:
    """The former place of the chair, and the chair."""
    _, truth = source_with_truth(_SPEC, options)
    thing = SCENES["chair"].build(options.synth).moving
    assert isinstance(thing, CarriedOff)
    return FormerPlace.of(thing, truth.T_world_cam[0]), thing


def freed(options: SourceOptions, track: Track) -> Freed:
    """Times until grid and distances of a rolling window have the chair's place free."""
    place, thing = place_and_thing(options)
    gone_s = thing.gone_from / options.synth.rate_hz
    window: RollingWindow | None = None
    meter = DistanceMeter()
    through = np.zeros(len(place.points), np.bool_)
    seen_s = grid_s = distances_s = None
    was_occupied = False
    next_s = 0.0
    for view in true_frames(_SPEC, options):
        now_s = 1e-9 * view.frame.stamp_ns
        store, T_world_cam, keyframe = track(view)
        if now_s >= gone_s:
            through |= place.seen_through(view)
            if seen_s is None and through.all():
                seen_s = now_s
        if now_s < next_s - _EARLY_S:
            continue
        next_s = now_s + _EVERY_S
        window = window or RollingWindow(store)
        known = window.take(view.frame.depth_m(), view.frame.camera, T_world_cam, keyframe)
        if now_s < gone_s:
            was_occupied = place.is_occupied_in_grid(grid_map(known))
        elif seen_s is not None:
            if grid_s is None and place.is_free_in_grid(grid_map(known)):
                grid_s = now_s - seen_s
            if distances_s is None and place.is_free_in(meter.measure(known)):
                distances_s = now_s - seen_s
    return Freed(grid_s, distances_s, was_occupied)


def tracked_poses(slam: Slam) -> Track:
    """A function that tracks frames with the library."""

    def track(view: TrueFrame) -> tuple[KeyframeStore, np.ndarray, int]:
        result = slam.process(view.frame)
        assert slam.store is not None
        return slam.store, result.T_world_cam, result.keyframe

    return track


def true_poses() -> Track:
    """A function that returns true poses; every fourth frame becomes a keyframe."""
    stores: list[KeyframeStore] = []
    count = 0

    def track(view: TrueFrame) -> tuple[KeyframeStore, np.ndarray, int]:
        nonlocal count
        frame = view.frame
        if not stores:
            arrays, units = MemoryAllocator(), frame.depth_units_per_m
            stores.append(KeyframeStore.create(arrays, frame.camera, units, _MOST_KEYFRAMES))
        if count % _KEYFRAME_EVERY == 0:
            stores[0].append(frame, view.T_world_cam)
        count += 1
        return stores[0], view.T_world_cam, stores[0].count - 1

    return track


if __name__ == "__main__":
    main()
