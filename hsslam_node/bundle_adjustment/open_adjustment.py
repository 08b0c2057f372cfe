"""The bundle adjustment that a configuration asks for; a file of its own because it imports both kinds."""

from hsslam_node.bundle_adjustment.adjustment import BundleAdjustment
from hsslam_node.bundle_adjustment.global_ba import GlobalBundleAdjustment
from hsslam_node.bundle_adjustment.graph_adjustment import GraphBundleAdjustment
from hsslam_node.config import SlamConfig
from hsslam_node.device.device import CPU, Device
from hsslam_node.map.parameters import FieldParameters


def open_adjustment(
    config: SlamConfig, parameters: FieldParameters, seed: int, device: Device = CPU
) -> BundleAdjustment:
    """The bundle adjustment of `config.ba.method`."""
    kind = GraphBundleAdjustment if config.ba.method == "graph" else GlobalBundleAdjustment
    return kind(config, parameters, seed, device)
