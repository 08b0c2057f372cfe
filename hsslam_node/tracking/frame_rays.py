"""Random rays of one frame."""

import numpy as np

from hsslam_node.config import SlamConfig
from hsslam_node.frame import Frame
from hsslam_node.kernels.ray_batch import gather_pixels
from hsslam_node.mapping.ray_batch import ray_batch

_CANDIDATES = 3  # pixels drawn for each wanted: some have no depth


class FrameRays:
    """Rays through random pixels that have depth; what is drawn depends on seed and frame index alone."""

    def __init__(self, config: SlamConfig, seed: int) -> None:
        self._config = config.rendering_tracker
        self._max_depth_m = config.mapper.max_depth_m
        self._seed = seed
        self.rays = ray_batch(self._config.pixels)  # the first `count` are real; slot 0
        self.count = 0
        self.jitter = np.zeros((self._config.pixels, config.sampling.count), np.float32)  # 0..1

    def observe(self, frame: Frame) -> None:
        """Take this frame and draw."""
        self._frame = frame
        self._generator = np.random.default_rng((self._seed, frame.index, 13))
        self.draw()

    def draw(self) -> None:
        """Draw pixels of the frame, and the places of their samples."""
        frame, camera, c = self._frame, self._frame.camera, self._config
        border = round(c.border * camera.width_px)
        uv = self._generator.integers(
            (border, border),
            (camera.width_px - border, camera.height_px - border),
            (_CANDIDATES * c.pixels, 2),
        )
        K = np.array([camera.fx, camera.fy, camera.cx, camera.cy], np.float32)
        self.count = gather_pixels(
            frame.color, frame.depth_raw, 1.0 / frame.depth_units_per_m, self._max_depth_m, K, uv,
            0, 0.0, 0, self.rays, 0, c.pixels,
        )  # fmt: skip
        self._generator.random(out=self.jitter[: self.count], dtype=np.float32)
