"""The interface of both methods of bundle adjustment, and when a round is due."""

from abc import ABC, abstractmethod
from contextlib import nullcontext

from hsslam_node.bundle_adjustment.report import BaReport, Lease, MayStep, Rest, always, no_rest
from hsslam_node.map.store import KeyframeStore


class BundleAdjustment(ABC):
    """Refines keyframe poses, and the map with them; the caller writes the poses back."""

    def __init__(self, every_keyframes: int) -> None:
        self._every_keyframes = every_keyframes
        self._used = 1  # keyframes that were there at the last round

    def is_due(self, store: KeyframeStore) -> bool:
        """Whether enough keyframes have come since the last round."""
        return store.count - self._adjusted(store) >= self._every_keyframes

    def is_behind(self, store: KeyframeStore) -> bool:
        """Whether there are keyframes that no round has used."""
        return store.count > self._adjusted(store)

    def has_joined(self, store: KeyframeStore) -> bool:
        """Whether a fragment has joined the map since the last round."""
        return store.joined_since(self._adjusted(store)) > 0

    @abstractmethod
    def round(
        self,
        store: KeyframeStore,
        lease: Lease = nullcontext,
        may_step: MayStep = always,
        rest: Rest = no_rest,
    ) -> BaReport:
        """Run one round. It holds `lease()` while it steps the map, for one iteration at a time.

        It asks `may_step()` before each iteration. If the answer is False, the round ends and moves no pose.
        It calls `rest()`, which may wait, between pieces of work and without the lease.
        """

    def _adjusted(self, store: KeyframeStore) -> int:
        """Number of keyframes at the last round, or in the saved map that the run began with."""
        return max(self._used, store.inherited)
