"""A small layout for tests."""

import pytest

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound
from hsslam_node.map.layout import FieldLayout


@pytest.fixture(scope="session")
def layout() -> FieldLayout:
    """A small room with dense and hashed levels."""
    config = FieldConfig(plane_channels=16, hash_table_log2=13)
    return FieldLayout.over(config, Bound((-1.0, -0.5, 0.2), (0.9, 0.7, 1.3)))
