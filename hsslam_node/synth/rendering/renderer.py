"""Renders a scene from any pose."""

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.synth.rendering.ray_caster import render
from hsslam_node.synth.scenes.scene import Scene, scene_arrays
from hsslam_node.synth.textures.atlas_cache import cached_atlas


class Renderer:
    """Colour and exact planar depth of a scene; one thread, no state between frames."""

    def __init__(self, scene: Scene, camera: Camera, units_per_m: float, seed: int) -> None:
        self._scene = scene
        self._arrays = scene_arrays(scene.parts_at(0))
        self._atlas = cached_atlas(scene, seed, float(np.clip(640 / camera.width_px, 0.6, 4.0)))
        self._intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._size = (camera.height_px, camera.width_px)
        self._units_per_m = units_per_m
        self._packed = np.empty(self._size, np.uint32)
        self._face_ids = np.empty(self._size, np.int32)

    def render(self, T_world_cam: np.ndarray, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 RGB and planar depth [H, W] uint16 from a pose [4, 4].

        `frame`: its number, which moving parts need.
        """
        if self._scene.moving:
            moving = scene_arrays(self._scene.moving.at(frame))
            for name in ("rotations", "centers"):
                self._arrays[name][-len(moving[name]) :] = moving[name]
        color = np.empty((*self._size, 3), np.uint8)
        depth = np.empty(self._size, np.uint16)
        a, b = self._arrays, self._atlas
        render(
            a["kinds"], a["rotations"], a["centers"], a["halves"],
            b.first_faces, b.first_levels, b.inverse_texels, b.levels, b.texels,
            np.ascontiguousarray(T_world_cam, np.float64), self._intrinsics,
            color, depth, self._units_per_m, self._packed, self._face_ids,
        )  # fmt: skip
        return color, depth
