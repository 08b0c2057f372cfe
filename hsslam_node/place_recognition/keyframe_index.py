"""Finds keyframes that share features with an image, by votes of descriptors in the same hash cells."""

import contextlib
from collections import deque
from functools import cache

import numpy as np

from hsslam_node.geometry.se3 import inverse, so3_log
from hsslam_node.map.store import KeyframeStore, RetiredKeyframeError
from hsslam_node.place_recognition.image_features import (
    DESCRIPTOR_SIZE,
    ImageFeatures,
    image_features,
)

_TABLES, _BITS = 8, 16  # each table cuts the space of descriptors into 2^16 cells
_CODES = _TABLES << _BITS
_NOTHING = _CODES  # the code of a missing feature
_FEATURES = 400  # of a keyframe, the strongest, which vote
_FEW = 60  # features: the image is dark or blurred


class KeyframeIndex:
    """An index of features of the keyframes of a store that show a new view.

    The index skips a keyframe if it has one within `spacing_m` and `spacing_rad`, so memory (100 kB
    a keyframe) and time grow with the space that was seen, not with the duration. One with few features
    (dark or blurred) keeps no other out. A retired keyframe leaves the index, and the keyframes near it are
    checked again. The index only reads the store: each
    process has its own.

    The cells of descriptors are those of random hyperplanes (Charikar 2002), the same in every index;
    there is no trained vocabulary. A shared cell counts more if fewer keyframes have it.
    """

    def __init__(
        self, store: KeyframeStore, spacing_m: float = 0.25, spacing_rad: float = 0.25
    ) -> None:
        self._store = store
        self._spacing = spacing_m, spacing_rad
        self._seen = 0  # ids from here on are new to the index
        self._pending: deque[int] = deque()  # ids to check
        self._features: dict[int, ImageFeatures] = {}
        self._codes = np.full((16, _FEATURES * _TABLES), _NOTHING, np.int32)  # row: a keyframe
        self._keyframes_with = np.zeros(_CODES + 1, np.int32)

    def __len__(self) -> int:
        return len(self._features)

    @property
    def keyframes(self) -> np.ndarray:
        """Ids of the indexed keyframes, [n] int, in the order of indexing."""
        return np.array(list(self._features), int)

    @property
    def is_complete(self) -> bool:
        """Whether every keyframe of the store has been checked."""
        return not self._pending and self._seen >= self._store.count

    def update(self, most: int | None = None, *, newest_first: bool = False) -> int:
        """Index new keyframes, at most `most` (15 ms each); returns their number."""
        taken = 0
        while most is None or taken < most:
            k = self.next_new(newest_first=newest_first)
            if k is None:
                break
            with contextlib.suppress(RetiredKeyframeError):  # meanwhile
                self.take(k, image_features(self._store.frame(k)))
            taken += 1
        return taken

    def take_in(self, keyframes: np.ndarray, most: int) -> None:
        """Index those of the keyframes [n] that show a new view, in this order, at most `most`."""
        for k in keyframes.tolist():
            if most and k not in self._features and self._is_new(k):
                with contextlib.suppress(RetiredKeyframeError):  # meanwhile
                    self.take(k, image_features(self._store.frame(k)))
                    most -= 1

    def next_new(self, *, newest_first: bool = False) -> int | None:
        """The next keyframe with a new view, by the current poses; for `take`."""
        kept = self._store.kept()
        self._pending.extend(kept[kept >= self._seen].tolist())
        self._seen = max(self._seen, int(kept.max(initial=-1)) + 1)
        self._forget_retired(kept)
        while self._pending:
            k = self._pending.pop() if newest_first else self._pending.popleft()
            if self._store.is_kept(k) and self._is_new(k):
                return k
        return None

    def take(self, k: int, features: ImageFeatures) -> None:
        """Index keyframe k with its features, whether its view is new or not."""
        row = len(self._features)
        if row == len(self._codes):
            self._codes = np.concatenate([self._codes, np.full_like(self._codes, _NOTHING)])
        codes = _codes(features)
        self._codes[row, : len(codes)] = codes
        self._keyframes_with[np.unique(codes)] += 1
        self._features[k] = features

    def _forget_retired(self, kept: np.ndarray) -> None:
        keyframes = self.keyframes
        stays = np.isin(keyframes, kept)
        if stays.all():
            return
        n = int(stays.sum())
        for codes in self._codes[: len(keyframes)][~stays]:
            self._keyframes_with[np.unique(codes[codes < _NOTHING])] -= 1
        self._codes[:n] = self._codes[: len(keyframes)][stays]
        self._codes[n : len(keyframes)] = _NOTHING
        self._features = {int(k): self._features[int(k)] for k in keyframes[stays]}
        again = np.zeros(len(kept), bool)
        at = self._store.poses_of(kept)[:, :3, 3]
        for T in self._store.poses_of(keyframes[~stays]):
            again |= np.linalg.norm(at - T[:3, 3], axis=1) < self._spacing[0]
        again &= ~np.isin(kept, [*self._features, *self._pending])
        self._pending.extend(kept[again].tolist())

    def features(self, k: int) -> ImageFeatures:
        """Features of keyframe k, computed now if it is not in the index."""
        return self._features.get(k) or image_features(self._store.frame(k))

    def similar(
        self, features: ImageFeatures, wanted: int, among: np.ndarray | None = None
    ) -> list[tuple[int, float]]:
        """The `wanted` keyframes that share most with an image, best first, with their votes.

        among: ids [n] of those that may be chosen; None: all. Keyframes without a vote are left out.
        """
        keyframes = self.keyframes
        if len(keyframes) == 0 or len(features) == 0:
            return []
        n = len(keyframes)
        rarity = np.zeros(_CODES + 1, np.float32)
        codes = np.unique(_codes(features))
        codes = codes[codes < _NOTHING]
        shared = self._keyframes_with[codes]
        rarity[codes] = np.log((1 + n) / np.maximum(shared, 1))
        votes = rarity[self._codes[:n]].sum(axis=1)  # [n]
        votes /= np.sqrt(np.maximum((self._codes[:n] < _NOTHING).sum(axis=1), 1))
        if among is not None:
            votes[~np.isin(keyframes, among)] = 0.0
        order = np.argsort(-votes, kind="stable")[:wanted]
        return [(int(keyframes[i]), float(votes[i])) for i in order if votes[i] > 0]

    def _is_new(self, k: int) -> bool:
        shown = [i for i, features in self._features.items() if len(features) >= _FEW]
        if not shown:
            return True
        T_cam_world = inverse(self._store.pose(k))
        near_m, near_rad = self._spacing
        relative = T_cam_world @ self._store.poses_of(np.array(shown))  # [n, 4, 4]
        for T in relative[np.linalg.norm(relative[:, :3, 3], axis=1) < near_m]:
            if np.linalg.norm(so3_log(T[:3, :3])) < near_rad:
                return False
        return True


def _codes(features: ImageFeatures) -> np.ndarray:
    """Cells of the strongest features in all tables, [n * tables] int32."""
    descriptors = features.descriptors[:_FEATURES].astype(np.float32)
    descriptors -= descriptors.mean(axis=1, keepdims=True)
    bits = (descriptors @ _hyperplanes() > 0).reshape(len(descriptors), _TABLES, _BITS)
    cells = bits @ (1 << np.arange(_BITS))  # [n, tables]
    return (cells + (np.arange(_TABLES) << _BITS)).astype(np.int32).ravel()


@cache
def _hyperplanes() -> np.ndarray:
    """Normals of random hyperplanes, [128, tables * bits] float32."""
    normals = np.random.default_rng(0).normal(size=(DESCRIPTOR_SIZE, _TABLES * _BITS))
    return normals.astype(np.float32)
