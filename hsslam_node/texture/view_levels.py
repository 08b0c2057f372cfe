"""Level of each keyframe in the logarithm of what it shows; alone, as exposure and sharpness use it."""

import numpy as np

_ROUNDS = 20


def view_levels(face: np.ndarray, view: np.ndarray, value: np.ndarray, views: int) -> np.ndarray:
    """Levels [views] float64, if each value is the level of its face plus that of its view.

    It alternates between means of faces and medians of views, which reflections do not move; the mean of the
    levels is 0.

    Args:
        face: [n] int64, number of the face of each value.
        view: [n] int64.
        value: [n] float64.
        views: number of views.
    """
    level = np.zeros(views)
    if len(face) == 0:
        return level
    faces = int(face.max()) + 1
    of_face = np.maximum(np.bincount(face, minlength=faces), 1)
    order = np.argsort(view, kind="stable")
    end = np.cumsum(np.bincount(view, minlength=views))
    shows = np.diff(end, prepend=0) > 0
    for _ in range(_ROUNDS):
        mean = np.bincount(face, value - level[view], faces) / of_face
        parts = np.split((value - mean[face])[order], end[:-1])
        level = np.array([np.median(part) if len(part) else 0.0 for part in parts])
        level[shows] -= level[shows].mean()
    return level
