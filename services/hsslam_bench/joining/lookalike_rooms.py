"""Counts wrong joins of a fragment to a map among thirty rooms that look alike; prints JSON.

`python -m hsslam_bench.joining.lookalike_rooms SEED`: in each of thirty pairs the map has one room of
`synth:lookalike`, and the fragment the next. Five controls have map and fragment in one room, with frames
between the map's keyframes. All keyframes have their true poses, so that no tracking error separates two
rooms. If both see the same place through a door, a join within 10 cm is right.
"""

import argparse
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.config import TrackerConfig
from hsslam_node.fragments.join_decision import agreed_meetings, fragment_place
from hsslam_node.fragments.join_search import meeting_of
from hsslam_node.frame import Frame
from hsslam_node.map.allocator import MemoryAllocator
from hsslam_node.map.store import KeyframeStore
from hsslam_node.merging.meetings import Meeting, pictures_of, places_apart
from hsslam_node.presets import REALTIME
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.scenes.lookalike import ROOM_M, ROOMS_A_ROW, lookalike_poses
from hsslam_node.tracking.places.relocalisation import Relocalisation

_KEYFRAMES = 12  # of map and fragment, each
_CONTROLS = 5
_OFF_M = 0.1  # a join with a larger error is wrong


@dataclass(frozen=True)
class _Views:
    """Frames of one room in order, with their true poses."""

    frames: list[Frame]
    T_world_cam: np.ndarray  # [n, 4, 4]


def main() -> None:
    parser = argparse.ArgumentParser(prog="lookalike_rooms", description=__doc__)
    parser.add_argument("seed", type=int)
    parser.add_argument("--quick", action="store_true", help="two rooms")
    arguments = parser.parse_args()
    rooms = 2 if arguments.quick else 2 * ROOMS_A_ROW
    print(json.dumps(lookalike_rooms(arguments.seed, rooms)))


def lookalike_rooms(seed: int, rooms: int) -> dict[str, Any]:
    """Counts of pairs of rooms that would be joined, and of controls."""
    views = [_views_of(seed, room) for room in range(rooms)]
    pairs = [_compared(views[k], views[(k + 1) % rooms], slice(0, None, 2)) for k in range(rooms)]
    joins = [agreed for found in pairs if (agreed := agreed_meetings(found))]
    controls = [_compared(v, v, slice(1, None, 2)) for v in views[:_CONTROLS]]
    return {
        "pairs": len(pairs),
        "wrong": sum(_off_m(agreed) >= _OFF_M for agreed in joins),
        "through_a_door": sum(_off_m(agreed) < _OFF_M for agreed in joins),
        "meetings": sum(len(found) for found in pairs),
        "alike": [_alike(found) for found in pairs],
        "controls": len(controls),
        "joined": sum(_is_joined(found) for found in controls),
        "control_alike": [_alike(found) for found in controls],
        "control_places": [places_apart(found) for found in controls],
    }


def _is_joined(found: list[Meeting]) -> bool:
    """Whether a control joins rightly: map and fragment have the same world."""
    agreed = agreed_meetings(found)
    return bool(agreed) and _off_m(agreed) < _OFF_M


def _off_m(agreed: list[Meeting]) -> float:
    at = np.append(agreed[0].T_world_second[:3, 3], 1.0)
    return float(np.linalg.norm((fragment_place(agreed).T_map_fragment @ at - at)[:3]))


def _alike(found: list[Meeting]) -> float:
    """Share of the compared blocks of all meetings that look alike; 1 without blocks."""
    pictures = pictures_of(found)
    return pictures.alike / pictures.compared if pictures.compared else 1.0


def _compared(known: _Views, seen: _Views, rows: slice) -> list[Meeting]:
    """Meetings of the views `rows` of `seen` with every second view of `known`."""
    store = _store(known, slice(0, None, 2))
    fragment = _store(seen, rows)
    config: TrackerConfig = REALTIME.tracker
    places = Relocalisation(config, store, 0)
    places.observe_all()
    return [
        meeting_of(store, fragment, k, again)
        for k in range(fragment.count)
        for again in places.compare(fragment.frame(k)).result()
    ]


def _store(views: _Views, rows: slice) -> KeyframeStore:
    frames, poses = views.frames[rows], views.T_world_cam[rows]
    first = frames[0]
    store = KeyframeStore.create(
        MemoryAllocator(), first.camera, first.depth_units_per_m, len(frames)
    )
    for frame, T in zip(frames, poses, strict=True):
        store.append(frame, T)
    return store


def _views_of(seed: int, room: int) -> _Views:
    """Views of a room, evenly spread over the time in it."""
    at = lookalike_poses(None, seed)[:, :2, 3]  # [n, 2]
    row, k = divmod(room, ROOMS_A_ROW)
    low = np.array([k * ROOM_M[0], row * ROOM_M[1]])
    inside = np.flatnonzero(((at > low) & (at < low + ROOM_M)).all(axis=1))
    # the first room also has frames at the end of the round: use only the first visit
    inside = inside[: int((np.diff(inside, append=len(at)) > 1).argmax()) + 1]
    stride = max(len(inside) // (2 * _KEYFRAMES), 1)
    synth = SynthOptions(width_px=320, height_px=240, seed=seed)
    options = SourceOptions(start=int(inside[0]), frames=2 * _KEYFRAMES, stride=stride, synth=synth)
    source, truth = source_with_truth("synth:lookalike", options)
    frames = [frame for frame in source.frames() if isinstance(frame, Frame)]
    return _Views(frames, truth.T_world_cam)


if __name__ == "__main__":
    main()
