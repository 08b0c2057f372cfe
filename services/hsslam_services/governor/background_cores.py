"""On which cores work that can wait runs under a quota; apart from reading it, which needs the system."""

import random
from collections.abc import Collection

_UNLIMITED = 0.1  # cores that a quota may lack
_POSES = 0.8  # cores that camera, tracker, recorder and supervisor use


def background_cores(cores: Collection[int], granted: float, seed: str) -> set[int]:
    """Cores of mapping, bundle adjustment and meshing, of those that the service may use.

    A group that has used up its quota stands still until the next period, poses too. On all cores at once
    work that can wait uses up 1.2 cores of 2 in 60 ms of 100; on one core it leaves the poses their time.

    Args:
        cores: numbers of the cores that the service may use.
        granted: cores' worth of time that its quota permits.
        seed: the same for all processes of a run, so that they share their cores.
    """
    if granted > len(cores) - _UNLIMITED:
        return set(cores)
    return set(random.Random(seed).sample(sorted(cores), max(int(granted - _POSES), 1)))
