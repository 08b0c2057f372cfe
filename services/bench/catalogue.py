"""All rows of the benchmark's table, in its order."""

from hsslam_node.services.bench.baseline_checks import baseline_checks
from hsslam_node.services.bench.check import Check
from hsslam_node.services.bench.faithful_checks import faithful_checks
from hsslam_node.services.bench.frozen_checks import frozen_checks
from hsslam_node.services.bench.fuzz_checks import fuzz_checks
from hsslam_node.services.bench.gap_checks import gap_checks
from hsslam_node.services.bench.gpu_checks import gpu_checks
from hsslam_node.services.bench.growth_checks import growth_checks
from hsslam_node.services.bench.kernel_checks import kernel_checks
from hsslam_node.services.bench.kidnapping_checks import kidnapping_checks
from hsslam_node.services.bench.localise_checks import localise_checks
from hsslam_node.services.bench.lockstep_checks import lockstep_checks
from hsslam_node.services.bench.map_checks import map_checks
from hsslam_node.services.bench.realtime_checks import realtime_checks
from hsslam_node.services.bench.refinement_checks import refinement_checks
from hsslam_node.services.bench.robustness_checks import robustness_checks
from hsslam_node.services.bench.stride_checks import stride_checks
from hsslam_node.services.bench.viewer_checks import viewer_checks


def catalogue() -> list[Check]:
    """The rows, in the order of the table."""
    return [
        *lockstep_checks(),
        *refinement_checks(),
        *robustness_checks(),
        *stride_checks(),
        *map_checks(),
        *gap_checks(),
        *kidnapping_checks(),
        *localise_checks(),
        *faithful_checks(),
        *viewer_checks(),
        *frozen_checks(),
        *fuzz_checks(),
        *realtime_checks(),
        *growth_checks(),
        *kernel_checks(),
        *baseline_checks(),
        *gpu_checks(),
    ]
