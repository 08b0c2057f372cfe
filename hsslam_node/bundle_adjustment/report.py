"""What one round of bundle adjustment did, and what all kinds of it have in common."""

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
    """One round. `keyframes` is empty where nothing was to be done."""

    keyframes: np.ndarray  # [n] ids
    T_then: np.ndarray  # T_world_cam [n, 4, 4] that the round began with
    T_world_cam: np.ndarray  # [n, 4, 4], refined
    loss_before: float
    loss_after: float
    moved: bool  # whether any pose changed
    loops: tuple[tuple[int, int], ...] = ()  # that were closed: ids of keyframes, the older first
    # keyframes there were; those that came since move as the last of these
    known: int | None = None


class BundleAdjustment(Protocol):
    """Refines keyframe poses, and the map with them; the caller writes the poses back."""

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        ...

    def is_behind(self, store: KeyframeStore) -> bool:
        """Whether there are keyframes that no round has looked at."""
        ...

    def has_joined(self, store: KeyframeStore) -> bool:
        """Whether a fragment has joined the map since the last round."""
        ...

    def round(
        self, store: KeyframeStore, lease: Lease = ..., may_step: MayStep = ..., rest: Rest = ...
    ) -> BaReport:
        """One round. `lease()` is held while the map is stepped, for one iteration at a time.

        Where `may_step()` says no, asked before each step, the round ends there and moves no pose.
        `rest()` may wait: it is called between pieces of work, when the lease is not held.
        """
        ...


def always() -> bool:
    """The map may be stepped at any time."""
    return True


def no_rest() -> None:
    """Go on at once."""


def nothing_done() -> BaReport:
    """A round in which nothing was to be done, or that was ended."""
    none = np.zeros((0, 4, 4))
    return BaReport(np.zeros(0, int), none, none, 0.0, 0.0, False)
