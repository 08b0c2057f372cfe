"""The arrays of one generation of the map; a map that grows moves to a new generation."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.allocator import ArrayAllocator
from hsslam_node.map.layout import FieldLayout

PAGE = 64  # chunks of 16 floats; a gradient has one word of marks a page
_NAMES = (
    "params",
    "adam_first",
    "adam_second",
    "params_stepped_at",
    "params_page_stepped_at",
    "published",
    "published_step",
    "field_bound",
)
_GRADIENT, _TOUCHED = "gradient", "gradient_touched"  # created by the first process that steps


@dataclass(frozen=True)
class ParameterArrays:
    """Parameters, moments and published slots over one bound."""

    layout: FieldLayout
    params: np.ndarray  # [P] float32
    first_moment: np.ndarray  # [P]
    second_moment: np.ndarray  # [P]
    stepped_at: np.ndarray  # [P / 16] int32: the Adam step that last moved each chunk
    page_stepped_at: np.ndarray  # [~P / 1024] int32: the same for pages of 64 chunks
    slots: np.ndarray  # [2, P] float32, published
    slot_step: np.ndarray  # [2] int64, the Adam step each slot is up to date with; -1: empty

    @classmethod
    def create(
        cls, arrays: ArrayAllocator, layout: FieldLayout, generation: int
    ) -> "ParameterArrays":
        """New arrays, or those of a process that died while it made them; all but the slots are set to 0."""
        P = layout.parameter_count
        shapes = ((P,), (P,), (P,), (P // 16,), (-(-P // (16 * PAGE)),), (2, P), (2,), (4, 3))
        types = (np.float32,) * 3 + (np.int32,) * 2 + (np.float32, np.int64, np.float64)
        made = [
            arrays.create(_name(name, generation), shape, dtype)
            for name, shape, dtype in zip(_NAMES, shapes, types, strict=True)
        ]
        if generation == 0:  # arrays of later generations are always new
            for array in made[:5]:
                array[:] = 0
        made[6][:] = -1
        first = layout.lattice
        made[7][:] = layout.bound.low, layout.bound.high, first.low, first.high
        return cls(layout, *made[:7])

    @classmethod
    def open(
        cls, arrays: ArrayAllocator, config: FieldConfig, generation: int
    ) -> "ParameterArrays":
        """Attach; KeyError if the arrays do not exist, or no longer."""
        *opened, corners = (arrays.open(_name(name, generation)) for name in _NAMES)
        bound, first = Bound.of(*corners[:2]), Bound.of(*corners[2:])
        layout = FieldLayout(config, bound, None if generation == 0 else first)
        return cls(layout, *opened)

    @staticmethod
    def gradient(
        arrays: ArrayAllocator, layout: FieldLayout, generation: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Values [P] float32 of the gradient and a bit a chunk [~P / 1024] uint64, created if missing.

        Raises:
            OutOfMemoryError: there is no room for them.
        """
        P = layout.parameter_count
        values = arrays.create(_name(_GRADIENT, generation), (P,), np.float32)
        words = -(-P // (16 * PAGE))
        return values, arrays.create(_name(_TOUCHED, generation), (words,), np.uint64)

    @staticmethod
    def remove(arrays: ArrayAllocator, generation: int) -> None:
        """Remove the arrays; a process that has opened them keeps the memory until it closes them."""
        for name in (*_NAMES, _GRADIENT, _TOUCHED):
            arrays.remove(_name(name, generation))


def _name(name: str, generation: int) -> str:
    return name if generation == 0 else f"{name}.{generation}"
