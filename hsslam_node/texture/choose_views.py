"""Chooses the keyframe that each triangle takes its colours from."""

from typing import NamedTuple

import numpy as np

from hsslam_node.kernels.compiled import njit
from hsslam_node.texture.face_views import FaceViews
from hsslam_node.texture.view_levels import view_levels

NO_VIEW = -1
_SWEEPS = 6
_TOGETHER = 0.4  # score for each neighbour with the same keyframe: as 1.5 times the pixels
_DOUBT = 3.0  # penalty for a triangle next to a nearer surface, or without depth
_BURNT = 0.7  # penalty for a triangle with a saturated colour
_STRANGE, _MOST_STRANGE = 10.0, 4.0  # levels, of 255, for a penalty of 1; largest penalty
_DARKEST, _BRIGHTEST = 8.0, 247.0  # brightness outside does not show the exposure
_LEAST_DETAIL = 2.0  # 1/px, in the sharpest image of a triangle: with less it shows no sharpness
_NOISE = 0.5  # 1/px
_MOST_GAIN = 0.7  # of its logarithm


class ChosenViews(NamedTuple):
    """A keyframe for each triangle, and gains that equalise the exposures."""

    view: np.ndarray  # [F] int32, `NO_VIEW`: no keyframe sees it
    gain: np.ndarray  # [views, 3] float64: factor of red, green and blue that makes views alike


def choose_views(faces: np.ndarray, seen: list[FaceViews]) -> ChosenViews:
    """Choose the best keyframe for each triangle of faces [F, 3], among those that see it; empties `seen`.

    The score counts the pixels that the triangle covers, the sharpness of the image compared with others of
    the same triangles, the penalties above, and neighbours with the same keyframe, for few visible borders.
    """
    views = len(seen)
    view = np.repeat(np.arange(views, dtype=np.int32), [len(one.faces) for one in seen])
    face, area_px, is_doubtful, color, detail = map(np.concatenate, zip(*seen, strict=True))
    seen.clear()  # there may be gigabytes of them
    burnt = color.max(axis=1) > _BRIGHTEST
    lit = ~burnt & (color.min(axis=1) > _DARKEST)
    exposure = np.stack(
        [view_levels(face[lit], view[lit], np.log(color[lit, k]), views) for k in range(3)], 1
    )
    most = np.zeros(len(faces), np.float32)
    np.maximum.at(most, face, detail)
    clear = most[face] > _LEAST_DETAIL
    sharpness = view_levels(face[clear], view[clear], np.log(detail[clear] + _NOISE), views)
    gain = np.exp(-np.clip(exposure, -_MOST_GAIN, _MOST_GAIN))
    score = np.log(np.maximum(area_px, 1e-3)) + 2 * sharpness[view] - _DOUBT * is_doubtful
    score -= _BURNT * burnt + _strangeness(face, view, color, gain, len(faces))
    order = np.lexsort((view, face))
    first = np.searchsorted(face[order], np.arange(len(faces) + 1))
    chosen = _choose(first, view[order], score[order].astype(np.float64), neighbours(faces))
    return ChosenViews(chosen, gain)


def _strangeness(
    face: np.ndarray, view: np.ndarray, color: np.ndarray, gain: np.ndarray, faces: int
) -> np.ndarray:
    """Penalty [n] for a colour [n, 3], times the gain of its view, that differs from the mean of its face.

    Few keyframes show a reflection, or an object in front of the surface that depth missed.
    """
    count = np.maximum(np.bincount(face, minlength=faces), 1)
    squares = np.zeros(len(face))
    for channel in range(3):  # one after the other, as n may be 50 millions
        made_alike = color[:, channel] * gain[view, channel]
        made_alike -= (np.bincount(face, made_alike, faces) / count)[face]
        squares += np.square(made_alike, out=made_alike)
    return np.minimum(np.sqrt(squares) / _STRANGE, _MOST_STRANGE)


def neighbours(faces: np.ndarray) -> np.ndarray:
    """[F, 3] int64: the triangle beyond each edge, -1: none."""
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    beyond = np.full(len(edges), -1, np.int64)
    one, other = order[same], order[same + 1]
    beyond[one], beyond[other] = other // 3, one // 3
    return beyond.reshape(-1, 3)


@njit(cache=True, nogil=True)
def _choose(first, view, score, neighbours):
    """The best view of each face, then some rounds in which neighbours count (iterated conditional modes)."""
    chosen = np.full(len(neighbours), NO_VIEW, np.int32)
    for sweep in range(_SWEEPS + 1):
        for f in range(len(neighbours)):
            best = -np.inf
            for i in range(first[f], first[f + 1]):
                value = score[i]
                if sweep:
                    for edge in range(3):
                        g = neighbours[f, edge]
                        if g >= 0 and chosen[g] == view[i]:
                            value += _TOGETHER
                if value > best:
                    best = value
                    chosen[f] = view[i]
    return chosen
