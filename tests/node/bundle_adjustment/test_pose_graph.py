"""The pose graph against a dense reference, and what holds for any graph."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from hsslam_node.bundle_adjustment.pose_graph import PoseEdge, PoseEdges, solve_pose_graph
from hsslam_node.geometry.se3 import inverse, se3_exp, se3_log

_SIGMA = np.repeat([1e-3, 4e-4], 3)  # m, rad
_INFORMATION = np.diag(_SIGMA**-2)


def _ring(n: int, rng: np.random.Generator) -> np.ndarray:
    """Poses [n, 4, 4] about a circle, pose 0 the world."""
    T = [np.eye(4)]
    for _ in range(n - 1):
        turn = np.array([0.05, 0, 0.2, 0, 2 * np.pi / n, 0])
        T.append(T[-1] @ se3_exp(turn + 0.02 * rng.normal(size=6)))
    return np.stack(T)


def _edge(T: np.ndarray, i: int, j: int, switchable: bool = False, error=None) -> PoseEdge:
    measured = inverse(T[i]) @ T[j]
    if error is not None:
        measured = measured @ se3_exp(error)
    return PoseEdge(i, j, measured, _INFORMATION, switchable)


def _drifted(edges: list[PoseEdge], n: int) -> np.ndarray:
    """Poses by the edges of the chain alone."""
    T = [np.eye(4)]
    for edge in edges[: n - 1]:
        T.append(T[-1] @ edge.T_first_second)
    return np.stack(T)


def _fixed(n: int) -> np.ndarray:
    return np.arange(n) == 0


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    return max(float(np.abs(se3_log(inverse(x) @ y)).max()) for x, y in zip(a, b, strict=True))


def _noisy_ring(n: int, rng: np.random.Generator) -> tuple[np.ndarray, list[PoseEdge]]:
    """A chain, every second neighbour, and the edge that closes the ring, all with noise."""
    T = _ring(n, rng)
    pairs = [(k, k + 1) for k in range(n - 1)] + [(k, k + 2) for k in range(n - 2)] + [(0, n - 1)]
    return T, [_edge(T, i, j, error=_SIGMA * rng.normal(size=6)) for i, j in pairs]


def test_the_least_squares_are_those_of_a_dense_solver():
    n = 8
    _, edges = _noisy_ring(n, np.random.default_rng(1))
    start = _drifted(edges, n)

    def residuals(x: np.ndarray) -> np.ndarray:
        T = [start[0], *(start[k + 1] @ se3_exp(x[6 * k : 6 * k + 6]) for k in range(n - 1))]
        each = [
            se3_log(inverse(e.T_first_second) @ inverse(T[e.first]) @ T[e.second]) for e in edges
        ]
        return (np.stack(each) / _SIGMA).ravel()

    dense = least_squares(residuals, np.zeros(6 * (n - 1)), xtol=1e-14, ftol=1e-14, gtol=1e-12)
    result = solve_pose_graph(start, PoseEdges.of(edges), _fixed(n))
    assert result.cost_after == pytest.approx(2 * dense.cost, rel=1e-6)
    expected = [
        start[0],
        *(start[k + 1] @ se3_exp(dense.x[6 * k : 6 * k + 6]) for k in range(n - 1)),
    ]
    assert _apart(result.T_world_cam, np.stack(expected)) < 1e-5


def test_fixed_poses_stay_and_the_rest_hangs_on_them():
    n = 12
    _, edges = _noisy_ring(n, np.random.default_rng(2))
    start = _drifted(edges, n)
    fixed = np.arange(n) < 5
    result = solve_pose_graph(start, PoseEdges.of(edges), fixed)
    np.testing.assert_array_equal(result.T_world_cam[fixed], start[fixed])
    assert result.cost_after < result.cost_before
    everything = solve_pose_graph(start, PoseEdges.of(edges), np.ones(n, bool))
    np.testing.assert_array_equal(everything.T_world_cam, start)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.integers(3, 25))
def test_consistent_edges_are_met_exactly_from_a_bad_start(seed, n):
    rng = np.random.default_rng(seed)
    T = _ring(n, rng)
    edges = [_edge(T, k, k + 1) for k in range(n - 1)] + [_edge(T, 0, n - 1, switchable=True)]
    start = np.stack([T[0], *(M @ se3_exp(0.05 * rng.normal(size=6)) for M in T[1:])])
    result = solve_pose_graph(start, PoseEdges.of(edges), _fixed(n))
    assert _apart(result.T_world_cam, T) < 1e-6
    assert result.cost_after < 1e-6 and result.weights.min() > 0.999


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000))
def test_the_world_may_lie_anywhere(seed):
    rng = np.random.default_rng(seed)
    n = 10
    _, edges = _noisy_ring(n, rng)
    start = _drifted(edges, n)
    G = se3_exp(rng.normal(size=6))
    here = solve_pose_graph(start, PoseEdges.of(edges), _fixed(n)).T_world_cam
    there = solve_pose_graph(G @ start, PoseEdges.of(edges), _fixed(n)).T_world_cam
    np.testing.assert_allclose(there, G @ here, atol=1e-7)


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.floats(0.05, 2.0))
def test_a_wrong_edge_costs_nothing(seed, size):
    rng = np.random.default_rng(seed)
    n = 30
    _, edges = _noisy_ring(n, rng)
    start = _drifted(edges, n)
    T = solve_pose_graph(start, PoseEdges.of(edges), _fixed(n)).T_world_cam
    error = rng.normal(size=6)
    wrong = _edge(T, 4, 21, True, error=size * error / np.linalg.norm(error))
    result = solve_pose_graph(start, PoseEdges.of([*edges, wrong]), _fixed(n))
    assert result.weights[-1] < 0.05
    assert _apart(result.T_world_cam, T) < 1e-3


def test_true_loops_close_a_large_drift_where_a_wrong_one_speaks_against_them():
    rng = np.random.default_rng(3)
    n = 60
    T = _ring(n, rng)
    chain = [
        replace(
            _edge(T, k, k + 1, error=3 * _SIGMA * rng.normal(size=6)),
            information=_INFORMATION / 9,
        )
        for k in range(n - 1)
    ]
    loops = [
        _edge(T, k, n - 1 - k, True, error=_SIGMA * rng.normal(size=6)) for k in range(0, 6, 2)
    ]
    wrong = [_edge(T, 10, 45, True, error=np.array([0.5, 0, 0.3, 0, 0.2, 0]))]
    start = _drifted(chain, n)
    result = solve_pose_graph(start, PoseEdges.of([*chain, *loops, *wrong]), _fixed(n))
    assert (result.weights[n - 1 : -1] > 0.3).all() and result.weights[-1] < 0.01
    end = np.linalg.norm(start[-1, :3, 3] - T[-1, :3, 3])
    assert end > 0.03
    assert np.linalg.norm(result.T_world_cam[-1, :3, 3] - T[-1, :3, 3]) < 0.005


def test_a_graph_without_edges_or_with_one_pose_is_left_alone():
    T = _ring(3, np.random.default_rng(0))
    result = solve_pose_graph(T[:1], PoseEdges.of([]), _fixed(1))
    np.testing.assert_array_equal(result.T_world_cam, T[:1])
    assert result.cost_before == result.cost_after == 0.0
