"""Triangles are kept that some keyframe looked at, less what was carried off: no curtain, no second skin."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.faces_seen import faces_seen

CAMERA = Camera(160, 120, 80.0, 80.0, 79.5, 59.5)


def _square(z: float, *, half: float = 0.3, front: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a square across the optical axis; its front looks at the camera."""
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    return np.array(corners), faces if front else faces[:, ::-1]


def _seen(vertices, faces, depth_m=2.0, T=None):
    depth = np.full((120, 160), depth_m, np.float32)
    return _seen_by([(depth, np.eye(4) if T is None else T)], vertices, faces)


def _seen_by(keyframes, vertices, faces):
    with ThreadPoolExecutor(1) as pool:
        return faces_seen(vertices, faces, CAMERA, keyframes, pool)


def test_what_was_measured_is_kept():
    assert _seen(*_square(2.0)).all()
    assert _seen(*_square(2.03)).all()  # within the noise of the depth


@pytest.mark.parametrize("z", [1.8, 2.2])
def test_a_skin_in_front_or_behind_goes(z):
    assert not _seen(*_square(z)).any()


def test_the_back_of_a_surface_goes():
    assert not _seen(*_square(2.0, front=False)).any()


def test_a_curtain_along_the_rays_goes():
    """It hangs from the measured surface towards the camera; its end alone is near a measurement."""
    vertices = np.array([(0.0, -0.2, 1.7), (0.0, 0.2, 1.7), (0.0, 0.2, 2.0), (0.0, -0.2, 2.0)])
    for faces in (np.array([[0, 1, 2], [0, 2, 3]]), np.array([[2, 1, 0], [3, 2, 0]])):
        assert not _seen(vertices, faces).any()


def test_without_measurement_or_out_of_sight_nothing_is_kept():
    assert not _seen(*_square(2.0), depth_m=0.0).any()
    behind = np.diag([1.0, -1.0, -1.0, 1.0])
    assert not _seen(*_square(2.0), T=behind).any()
    assert not _seen_by([], *_square(2.0)).any()


def _view(depth_m: float) -> tuple[np.ndarray, np.ndarray]:
    return np.full((120, 160), depth_m, np.float32), np.eye(4)


def test_what_three_later_keyframes_look_through_is_gone():
    square = _square(2.0)
    assert not _seen_by([_view(2.0)] + 3 * [_view(3.0)], *square).any()
    assert _seen_by([_view(2.0)] + 2 * [_view(3.0)], *square).all()
    assert _seen_by([_view(2.0)] + 5 * [_view(2.1)], *square).all()  # noise sees as much farther


def test_what_was_put_there_later_stays():
    assert _seen_by(3 * [_view(3.0)] + [_view(2.0)], *_square(2.0)).all()
    again = [_view(2.0), *3 * [_view(3.0)], _view(2.0), *2 * [_view(3.0)]]
    assert _seen_by(again, *_square(2.0)).all()


@pytest.mark.parametrize("elsewhere_m", [0.0, 1.0])
def test_a_gap_as_wide_as_a_triangle_says_nothing(elsewhere_m):
    """Beside the edge of what stands there a keyframe whose pose is a little off sees far."""
    depth = np.full((120, 160), elsewhere_m, np.float32)
    depth[58:62, 78:82] = 3.0
    small = _square(1.0, half=0.01)
    assert _seen_by([_view(1.0)] + 3 * [(depth, np.eye(4))], *small).all()
    depth[50:70, 70:90] = 3.0
    assert not _seen_by([_view(1.0)] + 3 * [(depth, np.eye(4))], *small).any()


def test_from_far_away_nothing_is_gone():
    assert _seen_by([_view(4.5)] + 3 * [_view(9.0)], *_square(4.5)).all()
    assert not _seen_by([_view(3.5)] + 3 * [_view(9.0)], *_square(3.5)).any()


def test_what_stood_too_near_to_a_wall_to_be_looked_through_goes_with_the_rest():
    """A board leans on a wall: its edge there goes too, the wall stays."""
    n = 12
    depth_of_rows = np.linspace(1.8, 1.96, n)  # the wall is at 2 m; the last rows are within 10 cm
    x, z = np.meshgrid([-0.2, 0.0, 0.2], depth_of_rows)
    y = np.repeat(np.linspace(-0.15, 0.15, n)[:, None], 3, axis=1)
    board = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    a = (np.arange(n - 1)[:, None] * 3 + np.arange(2)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 3, a + 1], axis=-1), np.stack([a + 1, a + 3, a + 4], axis=-1)]
    )
    wall, wall_faces = _square(2.0)
    vertices = np.concatenate([board, wall])
    both = np.concatenate([faces, wall_faces + len(board)])
    stood = np.full((120, 160), 2.0, np.float32)
    rows = np.arange(120)
    of_row = np.interp((rows - 59.5) / 80.0, board[::3, 1] / board[::3, 2], depth_of_rows)
    columns = np.abs(np.arange(160) - 79.5) < 12
    in_rows = np.abs((rows - 59.5) / 80.0) < 0.09
    stood[np.ix_(in_rows, columns)] = of_row[in_rows, None]
    before = _seen_by([(stood, np.eye(4)), _view(2.0)], vertices, both)
    after = _seen_by([(stood, np.eye(4)), *3 * [_view(2.0)]], vertices, both)
    assert before.all()
    assert not after[: len(faces)].any()
    assert after[len(faces) :].all()


def test_a_single_missed_triangle_between_others_is_kept():
    """A pixel without depth in the middle of a plane leaves no hole."""
    n = 21
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, n), np.linspace(-0.4, 0.4, n))
    vertices = np.stack([x.ravel(), y.ravel(), np.full(n * n, 2.0)], axis=-1)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + n, a + 1], axis=-1), np.stack([a + 1, a + n, a + n + 1], axis=-1)]
    )
    depth = np.full((120, 160), 2.0, np.float32)
    depth[59:61, 79:81] = 0.0
    assert _seen_by([(depth, np.eye(4))], vertices, faces).all()
    depth[50:70, 70:90] = 0.0
    assert not _seen_by([(depth, np.eye(4))], vertices, faces).all()
