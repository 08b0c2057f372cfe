"""Every parameter of the algorithm: frozen dataclasses, validated, with units in names and help."""

from hsslam_node.config.field import FieldConfig
from hsslam_node.config.mapping import (
    BundleAdjustmentConfig,
    KeyframeConfig,
    LossWeights,
    MapperConfig,
)
from hsslam_node.config.meshing import BoundConfig, MesherConfig
from hsslam_node.config.pose_graph import PoseGraphConfig
from hsslam_node.config.slam import SlamConfig
from hsslam_node.config.tracking import RenderingTrackerConfig, TrackerConfig

__all__ = [
    "BoundConfig",
    "BundleAdjustmentConfig",
    "FieldConfig",
    "KeyframeConfig",
    "LossWeights",
    "MapperConfig",
    "MesherConfig",
    "PoseGraphConfig",
    "RenderingTrackerConfig",
    "SlamConfig",
    "TrackerConfig",
]
