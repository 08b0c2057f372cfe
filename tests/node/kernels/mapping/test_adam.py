import numpy as np
import torch
from torch.optim import _functional as functional  # the classes would import torch.compile
from torch.optim.adam import adam

from hsslam_node.kernels.field.gradient import STRIPE, Gradient, add_gradient, touch_range
from hsslam_node.kernels.mapping.adam import sparse_adam
from hsslam_node.map.parameter_arrays import PAGE
from tests.node.kernels.marks import touch, touched_chunks

P = 640
RATES = np.array([[0, 320, 1e-2], [320, 640, 1e-3]])


def _state(seed=0):
    params = np.random.default_rng(seed).normal(size=P).astype(np.float32)
    grad = Gradient(np.zeros(P, np.float32), np.zeros(1, np.uint64), np.zeros(2, np.int64))
    moments = np.zeros((2, P), np.float32)
    return params, grad, moments, np.zeros(P // 16, np.int32)


def _step(params, grad, moments, stepped_at, step):
    _step_at(RATES, params, grad, moments, stepped_at, step)


def _step_at(rates, params, grad, moments, stepped_at, step):
    pages = np.zeros(1, np.int32)
    sparse_adam(
        params, moments[0], moments[1], grad, step, rates, 1e-15, 0.9, 0.99, stepped_at, pages, 0, 1
    )
    assert pages[0] == step


def test_dense_gradients_give_adam():
    params, grad, moments, stepped_at = _state()
    halves = torch.tensor(params).reshape(2, 320)
    first, second = torch.zeros((2, *halves.shape))
    counts = torch.zeros(2)
    for step in range(1, 30):
        g = np.random.default_rng(step).normal(size=P).astype(np.float32)
        grad.values[:] = g
        touch_range(grad, 0, P)
        _step(params, grad, moments, stepped_at, step)
        for k, lr in enumerate((1e-2, 1e-3)):
            adam(
                [halves[k]], [torch.tensor(g).reshape(2, 320)[k]], [first[k]], [second[k]], [],
                [counts[k]], amsgrad=False, beta1=0.9, beta2=0.99, lr=lr, weight_decay=0.0,
                eps=1e-15, maximize=False,
            )  # fmt: skip
    np.testing.assert_allclose(params, halves.numpy().ravel(), atol=2e-6)


def test_sparse_gradients_give_sparse_adam():
    """Moments of what has no gradient rest, the bias correction goes on."""
    params, grad, moments, stepped_at = _state()
    rows = torch.tensor(params.reshape(-1, 16))
    first, second = torch.zeros((2, *rows.shape))
    rates = np.array([[0, P, 1e-2]])
    for step in range(1, 40):
        rng = np.random.default_rng(step)
        chunks = np.flatnonzero(rng.random(P // 16) < 0.3)
        g = rng.normal(size=(len(chunks), 16)).astype(np.float32)
        grad.values.reshape(-1, 16)[chunks] = g
        touch(grad, chunks)
        gradient = torch.sparse_coo_tensor(
            torch.from_numpy(chunks)[None], torch.from_numpy(g), rows.shape, check_invariants=True
        )
        _step_at(rates, params, grad, moments, stepped_at, step)
        functional.sparse_adam(
            [rows], [gradient.coalesce()], [first], [second], [step], eps=1e-15, beta1=0.9,
            beta2=0.99, lr=1e-2, maximize=False,
        )  # fmt: skip
    np.testing.assert_allclose(params, rows.numpy().ravel(), atol=1e-5)


def test_untouched_chunks_stay_and_touched_ones_are_cleared():
    params, grad, moments, stepped_at = _state()
    before = params.copy()
    chunks = [0, 7, 8, 19, 20, 39]
    for chunk in chunks:
        grad.values[16 * chunk : 16 * chunk + 16] = 1.0
        touch(grad, [chunk])
    _step(params, grad, moments, stepped_at, 1)
    moved = np.flatnonzero((params != before).reshape(-1, 16).any(axis=1))
    assert moved.tolist() == chunks
    assert not grad.values.any() and not grad.touched.any()
    assert np.flatnonzero(stepped_at == 1).tolist() == chunks


def test_frozen_region_stays():
    params, grad, moments, stepped_at = _state()
    before = params.copy()
    grad.values[:] = 1.0
    touch_range(grad, 0, P)
    _step_at(RATES[1:], params, grad, moments, stepped_at, 1)
    np.testing.assert_array_equal(params[:320], before[:320])
    assert (params[320:] != before[320:]).all()
    assert touched_chunks(grad).tolist() == list(range(20))  # what was left is still marked


def test_only_what_is_marked_is_looked_at():
    """A map of a million chunks in which three have a gradient: dense and sparse step agree."""
    chunks = 1 << 20
    marked = [5, 64 * 100 + 63, chunks - 1]
    params, moments = np.ones(16 * chunks, np.float32), np.zeros((2, 16 * chunks), np.float32)
    grad = Gradient(
        np.zeros(16 * chunks, np.float32), np.zeros(chunks // 64, np.uint64), np.zeros(2, np.int64)
    )
    stepped_at, pages = np.zeros(chunks, np.int32), np.zeros(chunks // 64, np.int32)
    for chunk in marked:
        grad.values[16 * chunk : 16 * chunk + 16] = 2.0
        touch_range(grad, 16 * chunk, 16 * chunk + 16)
    rates = np.array([[0, 16 * chunks, 0.25]])
    sparse_adam(
        params, moments[0], moments[1], grad, 3, rates, 1e-15, 0.9, 0.99, stepped_at, pages, 0, 1
    )
    moved = np.flatnonzero((params != 1.0).reshape(-1, 16).all(axis=1))
    assert moved.tolist() == marked == np.flatnonzero(stepped_at == 3).tolist()
    assert np.flatnonzero(pages).tolist() == [0, 100, chunks // 64 - 1]
    assert not grad.values.any() and not grad.touched.any()


def test_hash_tables_are_stepped_by_their_gradient_alone():
    """Chunks 10 to 29 have no marks; a gradient that is not zero in one float of 16 is one."""
    params, grad, moments, stepped_at = _state()
    grad.unmarked[:] = 10, 30
    grad.values[16 * np.array([9, 10, 11, 29, 30])] = 1.0
    grad.values[16 * 20 + 15] = -1e-30
    _step(params, grad, moments, stepped_at, 1)
    stepped = [10, 11, 20, 29]
    assert np.flatnonzero(stepped_at).tolist() == stepped
    assert np.flatnonzero(grad.values).tolist() == [16 * 9, 16 * 30]  # not marked: not seen


def test_workers_step_each_its_stripes():
    """Together they leave what one leaves, of the sum of two gradients, and both gradients empty."""
    P = 16 * PAGE * (3 * STRIPE + 5)
    hashes = np.array([200, 400], np.int64)  # chunks
    rates = np.array([[0, 1600, 0.1], [1600, P - 3200, 0.2], [P - 3200, P, 0.3]])
    left = []
    for workers in (1, 2, 3):
        rng = np.random.default_rng(0)
        grads = [
            Gradient(np.zeros(P, np.float32), np.zeros(P // 16 // PAGE, np.uint64), hashes)
            for _ in range(2)
        ]
        for grad in grads:
            for chunk in rng.choice(P // 16, 3000, replace=False):
                grad.values[16 * chunk : 16 * chunk + 16] = rng.normal(size=16)
                if not hashes[0] <= chunk < hashes[1]:
                    touch_range(grad, 16 * chunk, 16 * chunk + 16)
        params, moments = np.zeros(P, np.float32), np.zeros((2, P), np.float32)
        stepped_at, pages = np.zeros(P // 16, np.int32), np.zeros(P // 16 // PAGE, np.int32)
        for worker in range(workers):
            add_gradient(grads[0], grads[1], worker, workers)
            sparse_adam(
                params, moments[0], moments[1], grads[0], 1, rates, 1e-15, 0.9, 0.99, stepped_at,
                pages, worker, workers,
            )  # fmt: skip
        assert not any(array.any() for grad in grads for array in grad[:2])
        left.append((params, *moments, stepped_at, pages))
    assert np.count_nonzero(left[0][3]) > 5000
    for other in left[1:]:
        for array, expected in zip(other, left[0], strict=True):
            np.testing.assert_array_equal(array, expected)
