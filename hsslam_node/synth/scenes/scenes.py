"""The built-in scenes by name."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.scenes.apartment import apartment_poses, build_apartment
from hsslam_node.synth.scenes.chair_scene import build_chair_scene, chair_scene_poses
from hsslam_node.synth.scenes.corridor import build_corridor, corridor_poses
from hsslam_node.synth.scenes.lookalike import build_lookalike, lookalike_poses
from hsslam_node.synth.scenes.person_scene import build_person_scene, person_scene_poses
from hsslam_node.synth.scenes.room import build_room
from hsslam_node.synth.scenes.room_motion import hand_held_poses
from hsslam_node.synth.scenes.scene import Scene


@dataclass(frozen=True)
class BuiltIn:
    """A scene, and the path of the camera through it."""

    build: Callable[[SynthOptions], Scene]
    poses: Callable[[SynthOptions], np.ndarray]
    """Camera-to-world poses [n, 4, 4] of all frames."""


SCENES = {
    "room": BuiltIn(
        lambda synth: build_room(synth.size_m, synth.seed),
        lambda synth: hand_held_poses(synth.size_m, synth.length or 600, synth.seed),
    ),
    "apartment": BuiltIn(
        lambda synth: build_apartment(synth.seed),
        lambda synth: apartment_poses(synth.length, synth.seed),
    ),
    "corridor": BuiltIn(
        lambda synth: build_corridor(synth.seed),
        lambda synth: corridor_poses(synth.length, synth.seed),
    ),
    "lookalike": BuiltIn(
        lambda synth: build_lookalike(synth.seed),
        lambda synth: lookalike_poses(synth.length, synth.seed),
    ),
    "person": BuiltIn(
        lambda synth: build_person_scene(synth.seed),
        lambda synth: person_scene_poses(synth.length, synth.seed),
    ),
    "chair": BuiltIn(
        lambda synth: build_chair_scene(synth.seed),
        lambda synth: chair_scene_poses(synth.length, synth.seed),
    ),
}
