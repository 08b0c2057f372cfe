"""Rounds of active global bundle adjustment."""

import dataclasses
from dataclasses import dataclass

import numpy as np

from hsslam_node.bundle_adjustment.loss_table import LossTable
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.field.parameters import FieldParameters
from hsslam_node.geometry.se3 import se3_exp
from hsslam_node.keyframes.store import KeyframeStore
from hsslam_node.mapping.map_optimiser import ADAM_BETA1
from hsslam_node.mapping.open_map_optimiser import open_map_optimiser

_POSE_BETA2, _POSE_EPS = 0.999, 1e-8


@dataclass(frozen=True)
class BaReport:
    """One round. `keyframes` is empty where none was badly rendered: nothing was done."""

    keyframes: np.ndarray  # [n] ids
    T_world_cam: np.ndarray  # [n, 4, 4], refined
    loss_before: float
    loss_after: float
    moved: bool  # whether any pose changed


class GlobalBundleAdjustment:
    """Measures random keyframes, refines the worst together with the map (paper III-C).

    All poses of the chosen keyframes are free but that of keyframe 0; their Adam moments are kept
    from round to round. The caller holds the parameters' lease and writes the poses back.
    """

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        self._config = config.ba
        rays = max(config.ba.rays, config.ba.probe_rays * config.ba.probe_keyframes)
        self._optimiser = open_map_optimiser(config, parameters, rays, device)
        self._table = LossTable(config.ba)
        self._seed = seed
        self._rounds = 0
        self._keyframes_at_round = 1
        self._moments: dict[int, _PoseMoments] = {}

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return store.count - self._keyframes_at_round >= self._config.every_keyframes

    def round(self, store: KeyframeStore) -> BaReport:
        """Probe, select, refine."""
        self._rounds += 1
        self._keyframes_at_round = store.count
        generator = np.random.default_rng((self._seed, 7, self._rounds))
        self._probe(store, generator)
        chosen = self._table.select()
        if len(chosen) == 0:
            return BaReport(chosen, np.zeros((0, 4, 4)), 0.0, 0.0, False)
        before = self._table.mean(chosen)
        all_poses = store.poses()
        poses = all_poses[chosen]
        counts = np.full(len(chosen), self._config.rays // len(chosen))
        free = self._config.pose_rate > 0
        for _ in range(self._config.iterations):
            report = self._optimiser.step(store, chosen, counts, poses, generator, with_poses=free)
            self._table.update(chosen, report.keyframe_loss)
            if free:
                for slot, k in enumerate(chosen):
                    if k != 0:
                        moments = self._moments.setdefault(int(k), _PoseMoments())
                        step = moments.step(report.pose_gradient[slot], self._config.pose_rate)
                        poses[slot] = moved_about_camera(poses[slot], step)
        self._optimiser.push()
        self._table.rest(chosen)
        moved = free and bool((poses != all_poses[chosen]).any())
        return BaReport(chosen, poses, before, self._table.mean(chosen), moved)

    def _probe(self, store: KeyframeStore, generator: np.random.Generator) -> None:
        n = min(self._config.probe_keyframes, store.count)
        keyframes = np.sort(generator.choice(store.count, n, replace=False))
        counts = np.full(n, self._config.probe_rays)
        poses = store.poses()[keyframes]
        report = self._optimiser.step(store, keyframes, counts, poses, generator, update=False)
        self._table.update(keyframes, report.keyframe_loss)


def moved_about_camera(T_world_cam: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The pose moved by a twist [6] (m, rad) in world axes, rotation about the camera's centre."""
    out = T_world_cam.copy()
    out[:3, :3] = se3_exp(np.array([0.0, 0.0, 0.0, *step[3:]]))[:3, :3] @ T_world_cam[:3, :3]
    out[:3, 3] += step[:3]
    return out


@dataclass
class _PoseMoments:
    """Adam state of one pose."""

    first: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(6))
    second: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(6))
    steps: int = 0

    def step(self, gradient: np.ndarray, rate: float) -> np.ndarray:
        self.steps += 1
        self.first = ADAM_BETA1 * self.first + (1 - ADAM_BETA1) * gradient
        self.second = _POSE_BETA2 * self.second + (1 - _POSE_BETA2) * gradient**2
        m = self.first / (1 - ADAM_BETA1**self.steps)
        v = self.second / (1 - _POSE_BETA2**self.steps)
        return -rate * m / (np.sqrt(v) + _POSE_EPS)
