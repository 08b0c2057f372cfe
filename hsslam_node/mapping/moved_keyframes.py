"""Keyframes that a correction has moved since they were mapped: the mapper draws them first, a few times."""

from typing import Protocol

import numpy as np

_MOVED_M, _MOVED_RAD = 1e-3, 1e-3  # smaller moves are below the map's resolution
_REPEATS = 8  # draws of a moved keyframe until the map has followed it


class MappedKeyframes(Protocol):
    """Where the poses are noted at which keyframes were mapped: the store."""

    def note_mapped(self, ids: np.ndarray, T_world_cam: np.ndarray, due: np.ndarray) -> None: ...

    def mapped(self, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]: ...


def draw_moved(
    store: MappedKeyframes,
    ids: np.ndarray,
    poses: np.ndarray,
    wanted: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Draw up to `wanted` of the keyframes `ids` [n] whose poses [n, 4, 4] have moved; notes it in `store`.

    A keyframe that is new to the mapper has not moved.
    """
    then, due = store.mapped(ids)
    is_new = then[:, 3, 3] == 0
    shift_m = np.linalg.norm(poses[:, :3, 3] - then[:, :3, 3], axis=1)
    # for small angles the matrices are sqrt(2) times the angle apart
    turn_rad = np.linalg.norm(poses[:, :3, :3] - then[:, :3, :3], axis=(1, 2)) / np.sqrt(2)
    moved = ~is_new & ((shift_m > _MOVED_M) | (turn_rad > _MOVED_RAD))
    due[moved] = _REPEATS
    waiting = np.flatnonzero(due > 0)
    size = min(wanted, len(waiting))
    drawn = generator.choice(waiting, size, replace=False) if size > 0 else waiting[:0]
    due[drawn] -= 1
    changed = moved | is_new
    then[changed] = poses[changed]
    noted = changed.copy()
    noted[drawn] = True
    store.note_mapped(ids[noted], then[noted], due[noted])
    return ids[drawn]
