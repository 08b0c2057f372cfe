"""The weighted sum of all loss terms."""

from dataclasses import dataclass, fields
from typing import Protocol

from torch import Tensor


class Weights(Protocol):
    """Weight of each term; a frozen dataclass of the configuration fits."""

    @property
    def color(self) -> float: ...
    @property
    def depth(self) -> float: ...
    @property
    def sdf_middle(self) -> float: ...
    @property
    def sdf_tail(self) -> float: ...
    @property
    def free_space(self) -> float: ...
    @property
    def patch(self) -> float: ...
    @property
    def smoothness(self) -> float: ...


@dataclass(frozen=True)
class LossTerms:
    """The terms before weighting, scalars; a term that was not computed is 0."""

    color: Tensor | float = 0.0
    depth: Tensor | float = 0.0
    sdf_middle: Tensor | float = 0.0
    sdf_tail: Tensor | float = 0.0
    free_space: Tensor | float = 0.0
    patch: Tensor | float = 0.0
    smoothness: Tensor | float = 0.0


def total_loss(terms: LossTerms, weights: Weights) -> Tensor | float:
    """Sum of weight times term."""
    total: Tensor | float = 0.0
    for term in fields(terms):
        total = total + getattr(weights, term.name) * getattr(terms, term.name)
    return total
