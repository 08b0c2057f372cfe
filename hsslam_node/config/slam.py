"""All parameters of the algorithm; a file of its own as it imports all groups of parameters."""

import dataclasses
from dataclasses import dataclass

from hsslam_node.config.field import FieldConfig
from hsslam_node.config.mapping import (
    BundleAdjustmentConfig,
    KeyframeConfig,
    LossWeights,
    MapperConfig,
)
from hsslam_node.config.meshing import BoundConfig, MesherConfig
from hsslam_node.config.pose_graph import PoseGraphConfig
from hsslam_node.config.tracking import RenderingTrackerConfig, TrackerConfig
from hsslam_node.rendering.ray_sampling import SamplingPattern


@dataclass(frozen=True)
class SlamConfig:
    """All parameters of the algorithm; `hsslam_node.presets` has complete sets of them."""

    field: FieldConfig = dataclasses.field(default_factory=FieldConfig)
    sampling: SamplingPattern = dataclasses.field(default_factory=SamplingPattern)
    weights: LossWeights = dataclasses.field(default_factory=LossWeights)
    keyframes: KeyframeConfig = dataclasses.field(default_factory=KeyframeConfig)
    mapper: MapperConfig = dataclasses.field(default_factory=MapperConfig)
    tracker: TrackerConfig = dataclasses.field(default_factory=TrackerConfig)
    rendering_tracker: RenderingTrackerConfig = dataclasses.field(
        default_factory=RenderingTrackerConfig
    )
    ba: BundleAdjustmentConfig = dataclasses.field(default_factory=BundleAdjustmentConfig)
    pose_graph: PoseGraphConfig = dataclasses.field(default_factory=PoseGraphConfig)
    mesher: MesherConfig = dataclasses.field(default_factory=MesherConfig)
    bound: BoundConfig = dataclasses.field(default_factory=BoundConfig)
