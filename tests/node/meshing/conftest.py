"""An analytic scene: a sphere on the floor of a box room, and cameras that look at it."""

from dataclasses import dataclass

import numpy as np
import pytest

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera

CENTRE, RADIUS_M = np.array([0.1, 0.05, 0.0]), 0.5
WALLS = np.array([1.5, 1.3, 1.0])  # half sides of the room
TRUNCATION_M = 0.06


@dataclass(frozen=True)
class Scene:
    bound: Bound
    camera: Camera
    keyframes: list[tuple[np.ndarray, np.ndarray]]

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Metric signed distance [N], positive in free space."""
        sphere = np.linalg.norm(points - CENTRE, axis=-1) - RADIUS_M
        return np.minimum(sphere, (WALLS - np.abs(points)).min(axis=-1))

    def sdf(self, points: np.ndarray) -> np.ndarray:
        """What a trained field says: truncated, and free again behind what cameras could see."""
        distance = self.distance(points)
        second_skin = np.where(distance < -TRUNCATION_M, 1.0, distance / TRUNCATION_M)
        return np.clip(second_skin, -1.0, 1.0)

    def color(self, points: np.ndarray) -> np.ndarray:
        return np.clip(points * 0.25 + 0.5, 0, 1)


@pytest.fixture(scope="session")
def scene() -> Scene:
    camera = Camera(160, 120, 80.0, 80.0, 79.5, 59.5)
    bound = Bound((-1.8, -1.6, -1.2), (1.8, 1.6, 1.2))
    blank = Scene(bound, camera, [])
    frames = [(_traced(blank, T), T) for T in _looks()]
    return Scene(bound, camera, frames)


def _looks() -> list[np.ndarray]:
    """Cameras in six places that turn all round and look up and down."""
    poses = []
    for x, y in ((1.2, 1.0), (-1.2, 1.0), (-1.2, -1.0), (1.2, -1.0)):
        for height in (0.7, -0.7):
            for yaw in np.arange(6) * np.pi / 3:
                for pitch in (-0.9, 0.0, 0.9):
                    z = np.array(
                        [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)]
                    )
                    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
                    T = np.eye(4)
                    T[:3, :3] = np.stack([right, np.cross(z, right), z], axis=1)
                    T[:3, 3] = x, y, height
                    poses.append(T)
    return poses


def _traced(scene: Scene, T: np.ndarray) -> np.ndarray:
    """Exact planar depth [H, W] by intersecting sphere and walls."""
    camera = scene.camera
    v, u = np.mgrid[: camera.height_px, : camera.width_px]
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    d = rays @ T[:3, :3].T
    o = T[:3, 3]
    with np.errstate(divide="ignore"):
        t = np.min(np.where(d > 0, (WALLS - o) / d, np.where(d < 0, (-WALLS - o) / d, 1e9)), -1)
    to = o - CENTRE
    a, b, c = (d * d).sum(-1), (d * to).sum(-1), to @ to - RADIUS_M**2
    root = b * b - a * c
    hit = (-b - np.sqrt(np.maximum(root, 0))) / a
    return np.where((root > 0) & (hit > 0), np.minimum(hit, t), t).astype(np.float32)
