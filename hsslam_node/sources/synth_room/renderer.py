"""Renders the room from any pose."""

import numpy as np

from hsslam_node.geometry.camera import Camera
from hsslam_node.sources.synth_room.atlas_cache import cached_atlas
from hsslam_node.sources.synth_room.primitive import Primitive
from hsslam_node.sources.synth_room.ray_caster import render


class Renderer:
    """Colour and exact planar depth of a scene; one thread, no state between frames."""

    def __init__(
        self, parts: list[Primitive], camera: Camera, units_per_m: float, seed: int
    ) -> None:
        self._arrays = scene_arrays(parts)
        self._atlas = cached_atlas(
            parts, self._arrays, seed, float(np.clip(640 / camera.width_px, 0.6, 4.0))
        )
        self._intrinsics = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
        self._size = (camera.height_px, camera.width_px)
        self._units_per_m = units_per_m
        self._packed = np.empty(self._size, np.uint32)
        self._face_ids = np.empty(self._size, np.int32)

    def render(self, T_world_cam: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Colour [H, W, 3] uint8 RGB and planar depth [H, W] uint16 from a pose [4, 4]."""
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


def scene_arrays(parts: list[Primitive]) -> dict[str, np.ndarray]:
    """Kinds [P], rotations [P, 3, 3], centers [P, 3] and halves [P, 3] (m), as the kernels take them."""
    return {
        "kinds": np.array([int(p.kind) for p in parts], np.int32),
        "rotations": np.stack([p.rotation for p in parts]).astype(np.float64),
        "centers": np.stack([p.center_m for p in parts]).astype(np.float64),
        "halves": np.stack([p.half_m for p in parts]).astype(np.float64),
    }
