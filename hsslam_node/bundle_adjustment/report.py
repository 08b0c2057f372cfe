"""The report of a round of bundle adjustment, and the interface that both methods share."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hsslam_node.map.store import KeyframeStore

Lease = Callable[[], AbstractContextManager[object]]
MayStep = Callable[[], bool]
Rest = Callable[[], None]


@dataclass(frozen=True)
class BaReport:
    """Report of one round. `keyframes` is empty if there was nothing to do."""

    keyframes: np.ndarray  # [n] ids
    T_then: np.ndarray  # T_world_cam [n, 4, 4] that the round began with
    T_world_cam: np.ndarray  # [n, 4, 4], refined
    loss_before: float
    loss_after: float
    moved: bool  # whether any pose changed
    loops: tuple[tuple[int, int], ...] = ()  # closed loops: keyframe ids, the older first
    # number of keyframes in this round; later keyframes move with the last of these
    known: int | None = None


class BundleAdjustment(Protocol):
    """Refines keyframe poses, and the map with them; the caller writes the poses back."""

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        ...

    def is_behind(self, store: KeyframeStore) -> bool:
        """Whether there are keyframes that no round has used."""
        ...

    def has_joined(self, store: KeyframeStore) -> bool:
        """Whether a fragment has joined the map since the last round."""
        ...

    def round(
        self, store: KeyframeStore, lease: Lease = ..., may_step: MayStep = ..., rest: Rest = ...
    ) -> BaReport:
        """Run one round. It holds `lease()` while it steps the map, for one iteration at a time.

        It asks `may_step()` before each iteration. If the answer is False, the round ends and moves no pose.
        It calls `rest()`, which may wait, between pieces of work and without the lease.
        """
        ...


def always() -> bool:
    """The map may be stepped at any time."""
    return True


def no_rest() -> None:
    """Do not wait."""


def nothing_done() -> BaReport:
    """Report of a round that had nothing to do, or that ended early."""
    none = np.zeros((0, 4, 4))
    return BaReport(np.zeros(0, int), none, none, 0.0, 0.0, False)
