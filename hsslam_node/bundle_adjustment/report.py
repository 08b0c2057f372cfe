"""The report of a round of bundle adjustment, and what its caller can give it."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np

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


def always() -> bool:
    """The map may be stepped at any time."""
    return True


def no_rest() -> None:
    """Do not wait."""


def nothing_done() -> BaReport:
    """Report of a round that had nothing to do, or that ended early."""
    none = np.zeros((0, 4, 4))
    return BaReport(np.zeros(0, int), none, none, 0.0, 0.0, False)
