"""Measures the time of the field's kernels and of their PyTorch reference; prints JSON.

`python -m hsslam_bench.scripts.kernel_speed RAYS SAMPLES CHANNELS` uses one numeric thread.
"""

import argparse
import json
import statistics
import time
from collections.abc import Callable

import numpy as np
import torch

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.kernels.field.activations import field_activations
from hsslam_node.kernels.field.backward import field_backward
from hsslam_node.kernels.field.forward import field_forward
from hsslam_node.kernels.field.gradient import gradient
from hsslam_node.kernels.field.layout import kernel_layout
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.layout import FieldLayout
from hsslam_node.reference.field import HybridField

_BOUND = Bound((-5.0, -3.0, -5.0), (5.0, 3.0, 5.0))  # m, of a room
_TURNS = 7  # after one warm-up; the result is their median


def main() -> None:
    parser = argparse.ArgumentParser(prog="kernel_speed", description=__doc__)
    for name in ("rays", "samples", "channels"):
        parser.add_argument(name, type=int)
    parser.add_argument("--quick", action="store_true", help="a single turn")
    arguments = parser.parse_args()
    turns = 1 if arguments.quick else _TURNS
    print(json.dumps(kernel_speed(arguments.rays, arguments.samples, arguments.channels, turns)))


def kernel_speed(rays: int, samples: int, channels: int, turns: int) -> dict[str, float]:
    """Median time of forward + backward to the parameters of one batch, ms; kernel and reference in turn."""
    torch.set_num_threads(1)
    layout = FieldLayout.over(FieldConfig(plane_channels=16 if channels == 16 else 32), _BOUND)
    params = initial_parameters(layout, seed=0)
    points = _samples_along_rays(rays, samples)  # [N, 3] m
    rng = np.random.default_rng(1)
    d_sdf = rng.standard_normal(len(points)).astype(np.float32)
    d_rgb = rng.standard_normal((len(points), 3)).astype(np.float32)
    kernel = _kernel(layout, params, points, d_sdf, d_rgb)
    reference = _reference(layout, params, points, d_sdf, d_rgb)
    kernel()
    reference()
    times = [(_milliseconds(kernel), _milliseconds(reference)) for _ in range(turns)]
    kernel_ms, reference_ms = (statistics.median(column) for column in zip(*times, strict=True))
    ratio = reference_ms / kernel_ms
    return {"kernel_ms": kernel_ms, "reference_ms": reference_ms, "ratio": ratio}


def _samples_along_rays(rays: int, samples: int) -> np.ndarray:
    """Points [N, 3] m as in mapping: a third in free space, the others near a surface."""
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((rays, 1, 3)) * (0.6, 0.4, 1.0)
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    surface_m = rng.uniform(1.0, 2.9, (rays, 1))
    near = surface_m + rng.uniform(-0.06, 0.06, (rays, samples - samples // 3))
    free = surface_m * rng.uniform(0.1, 1.0, (rays, samples // 3))
    z = np.sort(np.concatenate([free, near], axis=1), axis=1)
    return (direction * z[..., None]).reshape(-1, 3).astype(np.float32)


def _kernel(
    layout: FieldLayout,
    params: np.ndarray,
    points: np.ndarray,
    d_sdf: np.ndarray,
    d_rgb: np.ndarray,
) -> Callable[[], None]:
    n, flat = len(points), kernel_layout(layout)
    activations, found = field_activations(flat, n), gradient(flat)
    no_points = np.zeros((0, 3), np.float32)

    def turn() -> None:
        field_forward(params, flat, points, n, activations)
        field_backward(params, flat, n, activations, d_sdf, d_rgb, found, no_points, False)

    return turn


def _reference(
    layout: FieldLayout,
    params: np.ndarray,
    points: np.ndarray,
    d_sdf: np.ndarray,
    d_rgb: np.ndarray,
) -> Callable[[], None]:
    model = HybridField(layout, torch.from_numpy(params.copy()))
    x, upstream_sdf, upstream_rgb = map(torch.from_numpy, (points, d_sdf, d_rgb))

    def turn() -> None:
        model.params.grad = None
        out = model(x)
        torch.autograd.backward((out.sdf, out.color), (upstream_sdf, upstream_rgb))

    return turn


def _milliseconds(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - start)


if __name__ == "__main__":
    main()
