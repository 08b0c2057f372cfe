"""Descent on a bowl whose bottom is known."""

import numpy as np

from hsslam_node.config import RenderingTrackerConfig
from hsslam_node.geometry.se3 import so3_log
from hsslam_node.tracking.rendering_objective import descend
from tests.small_room import displaced, pose_error


class Bowl:
    """Squared distance of a pose to the bottom."""

    def __init__(self, bottom: np.ndarray, noise_m: float = 0.0) -> None:
        """`noise_m`: deviation of the bottom from call to call, as with fresh pixels."""
        self._bottom = bottom
        self._noise_m = noise_m
        self._generator = np.random.default_rng(0)
        self.visited: list[tuple[float, np.ndarray]] = []

    def observe(self, frame, view) -> None: ...

    def __call__(self, T_world_cam: np.ndarray) -> tuple[float, np.ndarray]:
        offset = T_world_cam[:3, 3] - self._bottom[:3, 3]
        offset += self._generator.normal(0.0, self._noise_m, 3)
        turn = so3_log(T_world_cam[:3, :3] @ self._bottom[:3, :3].T)
        loss = float(offset @ offset + turn @ turn)
        self.visited.append((loss, T_world_cam))
        return loss, 2 * np.concatenate([offset, turn])


def test_the_bottom_is_reached():
    bottom = displaced(np.eye(4), 0.5, 40.0, seed=1)
    config = RenderingTrackerConfig(iterations=80, translation_rate=1e-3, rotation_rate=1e-3)
    T = descend(Bowl(bottom), displaced(bottom, 0.02, 1.0, seed=2), config)
    distance_m, angle_deg = pose_error(T, bottom)
    assert distance_m < 1e-3 and angle_deg < 0.05


def test_the_best_pose_seen_is_kept():
    """With steps far too long, every pose after the first is worse."""
    bowl = Bowl(np.eye(4))
    config = RenderingTrackerConfig(
        iterations=5, settling_iterations=0, translation_rate=1.0, rotation_rate=1.0
    )
    start = displaced(np.eye(4), 0.02, 1.0)
    np.testing.assert_array_equal(descend(bowl, start, config), start)
    assert len(bowl.visited) == 5
    assert all(loss > bowl.visited[0][0] for loss, _ in bowl.visited[1:])


def test_shorter_steps_at_the_end_average_the_pixels():
    bottom = displaced(np.eye(4), 0.5, 40.0, seed=1)
    starts = [displaced(bottom, 0.006, 0.2, seed=seed) for seed in range(30)]

    def error_m(settling: int) -> float:
        config, bowl = RenderingTrackerConfig(settling_iterations=settling), Bowl(bottom, 0.002)
        return float(
            np.mean([pose_error(descend(bowl, start, config), bottom)[0] for start in starts])
        )

    assert error_m(4) < 0.85 * error_m(0)
