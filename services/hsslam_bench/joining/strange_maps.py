"""Counts wrong merges of sessions in different places; prints JSON.

`python -m hsslam_bench.joining.strange_maps SEED` compares each of seven rooms of the apartment with each of
seven rooms of the mirror image of another apartment, and the apartment's hall with the corridor: 50 pairs.
Keyframes have their true poses, so that no tracking error separates two maps.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.frame import Frame
from hsslam_node.geometry.se3 import inverse
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.merging.meetings import (
    FEWEST_PLACES,
    Meeting,
    agreeing,
    find_meetings,
    places_apart,
)
from hsslam_node.presets import REALTIME
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions

_ROOMS, _FRAMES, _EVERY = 7, 315, 15  # rooms, frames of a room, frames from keyframe to keyframe
_MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Stretch:
    """Keyframes of one room."""

    frames: Sequence[Frame]
    T_world_cam: np.ndarray  # [n, 4, 4], the first in the origin


def main() -> None:
    parser = argparse.ArgumentParser(prog="strange_maps", description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("--quick", action="store_true", help="two rooms")
    arguments = parser.parse_args()
    print(json.dumps(strange_maps(arguments.seed, 2 if arguments.quick else _ROOMS)))


def strange_maps(seed: int, rooms: int) -> dict[str, Any]:
    """Number of pairs, number that would merge, and the most places that agree in a pair."""
    places = [
        places_apart(agreeing(_meetings(first, second))) for first, second in _pairs(seed, rooms)
    ]
    merged = sum(n >= FEWEST_PLACES for n in places)
    return {"pairs": len(places), "merged": merged, "most_places": max(places)}


def in_mirror(stretch: Stretch) -> Stretch:
    """The keyframes of a camera in the mirror image of the place."""
    frames = [
        replace(f, color=f.color[:, ::-1].copy(), depth_raw=f.depth_raw[:, ::-1].copy())
        for f in stretch.frames
    ]
    return Stretch(frames, _MIRROR @ stretch.T_world_cam @ _MIRROR)


def _pairs(seed: int, rooms: int) -> Iterator[tuple[Stretch, Stretch]]:
    here = [_stretch("apartment", seed, room) for room in range(rooms)]
    there = [in_mirror(_stretch("apartment", seed + 1, room)) for room in range(rooms)]
    for first in here:
        for second in there:
            yield first, second
    yield here[-1], _stretch("corridor", seed, 0)


def _stretch(scene: str, seed: int, room: int) -> Stretch:
    synth = SynthOptions(width_px=320, height_px=240, seed=seed)
    options = SourceOptions(
        start=room * _FRAMES, frames=_FRAMES // _EVERY, stride=_EVERY, synth=synth
    )
    source, truth = source_with_truth(f"synth:{scene}", options)
    frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    return Stretch(frames, inverse(truth.T_world_cam[0]) @ truth.T_world_cam)


def _meetings(first: Stretch, second: Stretch) -> list[Meeting]:
    frame = first.frames[0]
    store = KeyframeStore.create(
        MemoryAllocator(), frame.camera, frame.depth_units_per_m, len(first.frames)
    )
    for frame, T in zip(first.frames, first.T_world_cam, strict=True):
        store.append(frame, T)
    return find_meetings(store, second.frames, second.T_world_cam, REALTIME.tracker)


if __name__ == "__main__":
    main()
