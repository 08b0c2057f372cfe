"""The built-in room, seen by a depth camera and a colour camera beside it."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import transform
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.synth.rendering.renderer import Renderer
from hsslam_node.synth.scenes.scenes import SCENES

COLOR = Camera(160, 120, 152.5, 152.0, 80.25, 59.0)
DEPTH = Camera(160, 120, 96.25, 96.25, 79.0, 59.75)  # sees more, at fewer pixels a degree
_TURN = Rotation.from_euler("xyz", [0.5, -0.7, 0.3], degrees=True)
T_COLOR_DEPTH = transform(np.array([0.0148, -0.0004, 0.0007]), _TURN.as_quat())


@dataclass(frozen=True, eq=False)
class Seen:
    """What both cameras see at one moment; depth in uint16."""

    color: np.ndarray  # [H, W, 3] uint8
    depth_raw: np.ndarray  # [H, W], of the depth camera
    exact: np.ndarray  # [H, W], depth of the pixels of colour


def seen_room(units_per_m: float, rows: Sequence[int] = (0, 40, 80)) -> list[Seen]:
    """The room from the poses of these rows of its trajectory."""
    synth = SynthOptions(width_px=COLOR.width_px, height_px=COLOR.height_px)
    scene, poses = SCENES["room"].build(synth), SCENES["room"].poses(synth)
    of_color, of_depth = (Renderer(scene, c, units_per_m, synth.seed) for c in (COLOR, DEPTH))
    seen = []
    for row in rows:
        color, exact = of_color.render(poses[row], row)
        _, depth_raw = of_depth.render(poses[row] @ T_COLOR_DEPTH, row)
        seen.append(Seen(color, depth_raw, exact))
    return seen


def expect_registered(found: np.ndarray, exact: np.ndarray, units_per_m: float) -> None:
    """Assert that registered depth [H, W] is that of the colour camera."""
    there = (found > 0) & (exact > 0)
    error_m = np.abs(found.astype(float) - exact) / units_per_m
    assert there.sum() > 0.98 * (exact > 0).sum()
    assert np.median(error_m[there]) < 0.7e-3
    around = np.ones((5, 5), np.uint8)
    step_m = (cv2.dilate(exact, around) - cv2.erode(exact, around)) / units_per_m
    assert np.mean(error_m[there & (step_m < 0.1)] > 0.05) < 2e-3  # the rest is beside edges
