"""Initial values of the scene model; apart from the parameters, as the reference uses them too."""

import math

import numpy as np

from hsslam_node.map.layout import FieldLayout

PLANE_SIGMA = 0.01
HASH_RANGE = 1e-4


def initial_parameters(layout: FieldLayout, seed: int | tuple[int, ...]) -> np.ndarray:
    """Fresh flat parameters [P] float32; the same for the same layout and seed.

    Planes N(0, 0.01^2) (ESLAM), hash tables U(-1e-4, 1e-4) (Instant-NGP), decoder weights
    U(-1/sqrt(fan in), 1/sqrt(fan in)) (torch.nn.Linear's default), log_beta from the config.
    Padding between blocks is zero.
    """
    params = np.zeros(layout.parameter_count, np.float32)
    generator = np.random.Generator(np.random.PCG64(seed))
    for block in layout.blocks.values():
        view = block.view(params)
        if block.name == "log_beta":
            view[:] = math.log(layout.config.beta_init)
        elif block.name.startswith("hash."):
            view[:] = _uniform(generator, block.shape, HASH_RANGE)
        elif "_decoder." in block.name:
            view[:] = _uniform(generator, block.shape, 1.0 / math.sqrt(block.shape[0]))
        else:
            view[:] = generator.standard_normal(block.shape, np.float32) * np.float32(PLANE_SIGMA)
    return params


def _uniform(generator: np.random.Generator, shape: tuple[int, ...], limit: float) -> np.ndarray:
    unit = generator.random(shape, np.float32)
    return (unit * np.float32(2.0) - np.float32(1.0)) * np.float32(limit)
