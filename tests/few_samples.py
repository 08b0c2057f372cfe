"""Fewer points on a surface than an evaluation has; alone, as tests of several folders use it."""

from functools import partial

import pytest

from hsslam_node.evaluation.mesh import mesh_judge
from hsslam_node.evaluation.mesh.mesh_metrics import compare_meshes
from hsslam_node.evaluation.mesh.published_protocol import compare_as_published

SAMPLES = 40_000


@pytest.fixture
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meshes are compared at a fifth of the points."""
    for compare in (compare_meshes, compare_as_published):
        monkeypatch.setattr(mesh_judge, compare.__name__, partial(compare, samples=SAMPLES))
