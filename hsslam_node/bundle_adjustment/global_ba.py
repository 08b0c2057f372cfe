"""Rounds of active global bundle adjustment: the keyframes that are rendered worst come first."""

from contextlib import nullcontext

import numpy as np

from hsslam_node.bundle_adjustment.report import (
    BaReport,
    Lease,
    MayStep,
    always,
    nothing_done,
)
from hsslam_node.config import BundleAdjustmentConfig, SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.geometry.pose_adam import PoseAdam
from hsslam_node.geometry.se3 import moved_about_camera
from hsslam_node.map.parameters import FieldParameters
from hsslam_node.map.store import KeyframeStore
from hsslam_node.mapping.map_optimiser import ADAM_BETA1
from hsslam_node.mapping.open_map_optimiser import open_map_optimiser


class LossTable:
    """Last known loss of every keyframe (paper III-C), with a rest for those just refined."""

    def __init__(self, config: BundleAdjustmentConfig) -> None:
        self._config = config
        self._loss = np.zeros(0)
        self._rests_until = np.zeros(0, np.int64)
        self._round = 0

    def update(self, keyframes: np.ndarray, losses: np.ndarray) -> None:
        """Note new losses [n] of keyframes [n]; keyframes that were never measured have none (nan)."""
        grown = int(keyframes.max(initial=-1)) + 1 - len(self._loss)
        if grown > 0:
            self._loss = np.append(self._loss, np.full(grown, np.nan))
            self._rests_until = np.append(self._rests_until, np.zeros(grown, np.int64))
        self._loss[keyframes] = losses

    def select(self) -> np.ndarray:
        """Begin a round: ids of the top N keyframes whose loss exceeds the threshold, worst first."""
        self._round += 1
        loss = np.where(self._rests_until >= self._round, np.nan, self._loss)
        candidates = np.flatnonzero(loss > self._config.loss_threshold)
        worst = candidates[np.argsort(-loss[candidates], kind="stable")]
        return worst[: self._config.top_keyframes]

    def rest(self, keyframes: np.ndarray) -> None:
        """Keep refined keyframes out of the next rounds."""
        self._rests_until[keyframes] = self._round + self._config.cooldown_rounds

    def mean(self, keyframes: np.ndarray) -> float:
        """Mean loss of these keyframes."""
        return float(np.mean(self._loss[keyframes]))


class GlobalBundleAdjustment:
    """Measures random keyframes, refines the worst together with the map (paper III-C).

    With uniform selection nothing is measured, and random keyframes are refined (Co-SLAM).

    All poses of the chosen keyframes are free but that of keyframe 0; their Adam moments are kept
    from round to round. The caller writes the poses back.
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
        self._moments: dict[int, PoseAdam] = {}

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return store.count - self._keyframes_at_round >= self._config.every_keyframes

    def round(
        self,
        store: KeyframeStore,
        lease: Lease = nullcontext,
        may_step: MayStep = always,
    ) -> BaReport:
        """Probe, select, refine. `lease()` is held for one iteration at a time, so that a mapper
        beside this process never waits for a whole round, and the round ends where `may_step()` says no."""
        self._rounds += 1
        self._keyframes_at_round = store.count
        generator = np.random.default_rng((self._seed, 7, self._rounds))
        with lease():
            chosen = self._select(store, generator)
        if len(chosen) == 0:
            return nothing_done()
        measured = self._config.selection == "active"
        losses = [self._table.mean(chosen)] if measured else []
        all_poses = store.poses()
        poses = all_poses[chosen]
        counts = np.full(len(chosen), self._config.rays // len(chosen))
        free = self._config.pose_rate > 0
        for _ in range(self._config.iterations):
            with lease():
                if not may_step():
                    return nothing_done()
                report = self._optimiser.step(
                    store, chosen, counts, poses, generator, with_poses=free
                )
                self._optimiser.push()
            losses.append(float(report.keyframe_loss.mean()))
            self._table.update(chosen, report.keyframe_loss)
            if free:
                for slot, k in enumerate(chosen):
                    if k != 0:
                        moments = self._moments.setdefault(int(k), PoseAdam(ADAM_BETA1))
                        step = moments.step(report.pose_gradient[slot], self._config.pose_rate)
                        poses[slot] = moved_about_camera(poses[slot], step)
        self._table.rest(chosen)
        moved = free and bool((poses != all_poses[chosen]).any())
        return BaReport(chosen, poses, losses[0], losses[-1], moved)

    def _select(self, store: KeyframeStore, generator: np.random.Generator) -> np.ndarray:
        if self._config.selection == "uniform":
            size = min(self._config.top_keyframes, store.count)
            return np.sort(generator.choice(store.count, size, replace=False))
        self._probe(store, generator)
        return self._table.select()

    def _probe(self, store: KeyframeStore, generator: np.random.Generator) -> None:
        n = min(self._config.probe_keyframes, store.count)
        keyframes = np.sort(generator.choice(store.count, n, replace=False))
        counts = np.full(n, self._config.probe_rays)
        poses = store.poses()[keyframes]
        report = self._optimiser.step(store, keyframes, counts, poses, generator, update=False)
        self._table.update(keyframes, report.keyframe_loss)
