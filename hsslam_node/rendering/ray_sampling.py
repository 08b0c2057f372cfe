"""Places samples along rays."""

from dataclasses import dataclass

import numpy as np

from hsslam_node.errors import UserError

_MOST_SAMPLES = 4096
_LONGEST_REACH = 1000.0


@dataclass(frozen=True)
class SamplingPattern:
    """Samples along a ray; defaults of the paper for Replica."""

    free_samples: int = 32
    """Stratified samples from the camera to beyond the surface."""
    surface_samples: int = 8
    """Stratified samples around the measured surface."""
    free_reach: float = 1.2
    """End of the free samples, times the measured depth."""
    surface_reach: float = 1.5
    """Half width of the surface samples, times the truncation distance."""

    def __post_init__(self) -> None:
        for name in ("free_samples", "surface_samples"):
            if not 0 <= (value := getattr(self, name)) <= _MOST_SAMPLES:
                raise UserError(f"sampling.{name} = {value}: expected 0 to {_MOST_SAMPLES}")
        if self.count == 0:
            raise UserError("sampling.surface_samples = 0: expected 1 or more without free samples")
        for name in ("free_reach", "surface_reach"):
            if not 0 < (value := getattr(self, name)) <= _LONGEST_REACH:
                raise UserError(
                    f"sampling.{name} = {value}: expected above 0, at most {_LONGEST_REACH:g}"
                )

    @property
    def count(self) -> int:
        """Samples of one ray, S."""
        return self.free_samples + self.surface_samples


def sample_rays(
    depth: np.ndarray,
    pattern: SamplingPattern,
    truncation_m: float,
    far_m: float,
    generator: np.random.Generator | None,
) -> np.ndarray:
    """Planar depth of the samples of each ray, sorted near to far.

    A ray without depth gets all its samples stratified over [0, far_m].

    Args:
        depth: [R] m, 0 = no measurement.
        pattern: numbers and reach.
        truncation_m: T, m.
        far_m: reach of rays without a measurement, m.
        generator: jitters each sample within its stratum; None puts it in the middle.

    Returns:
        z [R, S] float32 m
    """
    valid = depth > 0  # [R]
    reach = np.where(valid, pattern.free_reach * depth, far_m)
    free = _stratified(len(depth), pattern.free_samples, generator) * reach[:, None]
    half = pattern.surface_reach * truncation_m
    unit = _stratified(len(depth), pattern.surface_samples, generator)
    surface = np.maximum(depth[:, None] + (2.0 * unit - 1.0) * half, 0.0)
    z = np.concatenate([free, surface], axis=1)
    blind = np.flatnonzero(~valid)
    z[blind] = _stratified(len(blind), pattern.count, generator) * far_m
    z.sort(axis=1)
    return z.astype(np.float32)


def _stratified(rays: int, samples: int, generator: np.random.Generator | None) -> np.ndarray:
    """One place per stratum of [0, 1], [rays, samples]."""
    place = 0.5 if generator is None else generator.random((rays, samples))
    return np.broadcast_to((np.arange(samples) + place) / max(samples, 1), (rays, samples))
