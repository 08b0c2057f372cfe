"""Rounds of active global bundle adjustment: the keyframes that are rendered worst come first."""

from contextlib import nullcontext

import numpy as np

from hsslam_node.bundle_adjustment.adjustment import BundleAdjustment
from hsslam_node.bundle_adjustment.report import (
    BaReport,
    Lease,
    MayStep,
    Rest,
    always,
    no_rest,
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
    """The last known loss of every keyframe (paper III-C). Refined keyframes rest for some rounds."""

    def __init__(self, config: BundleAdjustmentConfig) -> None:
        self._config = config
        self._loss = np.zeros(0)
        self._rests_until = np.zeros(0, np.int64)
        self._round = 0

    def update(self, keyframes: np.ndarray, losses: np.ndarray) -> None:
        """Store new losses [n] of keyframes [n]. The loss of a keyframe that was never measured is nan."""
        grown = int(keyframes.max(initial=-1)) + 1 - len(self._loss)
        if grown > 0:
            self._loss = np.append(self._loss, np.full(grown, np.nan))
            self._rests_until = np.append(self._rests_until, np.zeros(grown, np.int64))
        self._loss[keyframes] = losses

    def select(self, kept: np.ndarray | None = None) -> np.ndarray:
        """Begin a round. Returns the ids of up to N keyframes of `kept` [m] (None: all) whose loss exceeds
        the threshold, worst first."""
        self._round += 1
        kept = np.arange(len(self._loss)) if kept is None else kept
        loss = np.full(len(self._loss), np.nan)
        kept = kept[kept < len(loss)]
        awake = kept[self._rests_until[kept] < self._round]
        loss[awake] = self._loss[awake]
        candidates = np.flatnonzero(loss > self._config.loss_threshold)
        worst = candidates[np.argsort(-loss[candidates], kind="stable")]
        return worst[: self._config.top_keyframes]

    def rest(self, keyframes: np.ndarray) -> None:
        """Keep refined keyframes out of the next rounds."""
        self._rests_until[keyframes] = self._round + self._config.cooldown_rounds

    def mean(self, keyframes: np.ndarray) -> float:
        """Mean loss of these keyframes."""
        return float(np.mean(self._loss[keyframes]))


class GlobalBundleAdjustment(BundleAdjustment):
    """Measures keyframes, refines the worst together with the map (paper III-C).

    If `batch_losses` is set, the losses that mapping iterations store count as well, and a round first
    measures keyframes without a loss. Uniform selection measures nothing and refines random keyframes
    (Co-SLAM).

    A round moves the poses of all chosen keyframes but keyframe 0, and keeps their Adam moments for later
    rounds. The caller writes the poses back.
    """

    def __init__(
        self, config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
    ) -> None:
        super().__init__(config.ba.every_keyframes)
        self._config = config.ba
        rays = max(config.ba.rays, config.ba.probe_rays * config.ba.probe_keyframes)
        self._optimiser = open_map_optimiser(config, parameters, rays, device)
        self._table = LossTable(config.ba)
        self._seed = seed
        self._rounds = 0
        self._moments: dict[int, PoseAdam] = {}

    def round(
        self,
        store: KeyframeStore,
        lease: Lease = nullcontext,
        may_step: MayStep = always,
        rest: Rest = no_rest,
    ) -> BaReport:
        """Measure losses, select keyframes, refine them. It holds `lease()` for one iteration at a time, so
        the mapper never waits for a whole round. If `may_step()` returns False, the round ends and moves no
        pose. It calls `rest()` before each iteration."""
        self._rounds += 1
        self._used = store.count
        generator = np.random.default_rng((self._seed, 7, self._rounds))
        chosen = self._select(store, generator, lease, rest)
        if len(chosen) == 0:
            return nothing_done()
        measured = self._config.selection == "active"
        losses = [self._table.mean(chosen)] if measured else []
        poses_before = store.poses_of(chosen)
        poses = poses_before.copy()
        counts = np.full(len(chosen), self._config.rays // len(chosen))
        free = self._config.pose_rate > 0
        for _ in range(self._config.iterations):
            rest()
            with lease():
                if not may_step():
                    return nothing_done()
                report = self._optimiser.step(
                    store, chosen, counts, poses, generator, with_poses=free
                )
                self._optimiser.push()
            losses.append(float(report.keyframe_loss.mean()))
            self._note(store, chosen, report.keyframe_loss)
            if free:
                for slot, k in enumerate(chosen):
                    if k != 0:
                        moments = self._moments.setdefault(int(k), PoseAdam(ADAM_BETA1))
                        step = moments.step(report.pose_gradient[slot], self._config.pose_rate)
                        poses[slot] = moved_about_camera(poses[slot], step)
        self._table.rest(chosen)
        moved = free and bool((poses != poses_before).any())
        return BaReport(chosen, poses_before, poses, losses[0], losses[-1], moved)

    def _select(
        self, store: KeyframeStore, generator: np.random.Generator, lease: Lease, rest: Rest
    ) -> np.ndarray:
        kept = store.kept()
        self._moments = {k: moments for k, moments in self._moments.items() if store.is_kept(k)}
        if self._config.selection == "uniform":
            size = min(self._config.top_keyframes, len(kept))
            return np.sort(kept[generator.choice(len(kept), size, replace=False)])
        for keyframes in self._to_measure(store, kept, generator):
            rest()
            with lease():
                self._measure(store, keyframes, generator)
        return self._table.select(kept)

    def _to_measure(
        self, store: KeyframeStore, kept: np.ndarray, generator: np.random.Generator
    ) -> list[np.ndarray]:
        """Ids of each batch to measure: with `batch_losses` unknown losses first; then random others."""
        size = self._config.probe_keyframes
        if not self._config.batch_losses:
            size = min(size, len(kept))
            return [np.sort(kept[generator.choice(len(kept), size, replace=False)])]
        losses = store.losses(kept)
        self._table.update(kept, losses)
        new, known = kept[np.isnan(losses)], kept[~np.isnan(losses)]
        others = min(size - len(new) % size, len(known))
        others = known[generator.choice(len(known), others, replace=False)]
        ids = np.append(new, np.sort(others))
        return [ids[first : first + size] for first in range(0, len(ids), size)]

    def _measure(
        self, store: KeyframeStore, keyframes: np.ndarray, generator: np.random.Generator
    ) -> None:
        counts = np.full(len(keyframes), self._config.probe_rays)
        poses = store.poses_of(keyframes)
        report = self._optimiser.step(store, keyframes, counts, poses, generator, update=False)
        self._note(store, keyframes, report.keyframe_loss)

    def _note(self, store: KeyframeStore, keyframes: np.ndarray, losses: np.ndarray) -> None:
        self._table.update(keyframes, losses)
        if self._config.batch_losses:
            store.note_losses(keyframes, losses)
