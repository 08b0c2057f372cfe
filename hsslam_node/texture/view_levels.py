"""Which number a keyframe adds to the logarithm of what it shows: exposure, sharpness."""

import numpy as np

_ROUNDS = 20


def view_levels(face: np.ndarray, view: np.ndarray, value: np.ndarray, views: int) -> np.ndarray:
    """[views] float64: level of each view if its values are that of the face plus its own level.

    Least squares, by turns for faces and views; the mean of the levels is 0.

    Args:
        face: [n] int64, number of the face of each value.
        view: [n] int64.
        value: [n] float64.
        views: how many there are.
    """
    level = np.zeros(views)
    if len(face) == 0:
        return level
    faces = int(face.max()) + 1
    of_face = np.maximum(np.bincount(face, minlength=faces), 1)
    of_view = np.bincount(view, minlength=views)
    for _ in range(_ROUNDS):
        mean = np.bincount(face, value - level[view], faces) / of_face
        level = np.bincount(view, value - mean[face], views) / np.maximum(of_view, 1)
        level -= level[of_view > 0].mean()
    return np.where(of_view > 0, level, 0.0)
