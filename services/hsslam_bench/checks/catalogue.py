"""All rows of the benchmark's table, in its order."""

from hsslam_bench.batch.rows import batch_checks
from hsslam_bench.checks.accuracy import covariance_checks, lockstep_checks, map_term_checks
from hsslam_bench.checks.camera import gap_checks, kidnapping_checks, localise_checks
from hsslam_bench.checks.check import Check
from hsslam_bench.checks.faithful import faithful_checks
from hsslam_bench.checks.faults import fault_checks
from hsslam_bench.checks.fuzz import fuzz_checks
from hsslam_bench.checks.live import realtime_checks
from hsslam_bench.checks.map import growth_checks, map_checks
from hsslam_bench.checks.map_worth.bundle_adjustment import bundle_adjustment_checks
from hsslam_bench.checks.map_worth.distances import distance_checks
from hsslam_bench.checks.map_worth.field_error import field_error_checks
from hsslam_bench.checks.map_worth.gravity import gravity_checks
from hsslam_bench.checks.map_worth.lost import lost_checks
from hsslam_bench.checks.map_worth.merge import merge_checks
from hsslam_bench.checks.map_worth.query_speed import query_checks
from hsslam_bench.checks.map_worth.rendering import rendering_checks
from hsslam_bench.checks.map_worth.texture import texture_checks
from hsslam_bench.checks.quota import quota_checks
from hsslam_bench.checks.robustness import (
    baseline_checks,
    lens_check,
    odometry_checks,
    refinement_checks,
    robustness_checks,
    stride_checks,
)
from hsslam_bench.checks.soak import soak_checks
from hsslam_bench.checks.speed import gpu_checks, kernel_checks
from hsslam_bench.checks.viewer import frozen_checks, robot_checks, viewer_checks
from hsslam_bench.peers.rows import peer_checks
from hsslam_bench.tables.rows import paper_checks


def catalogue() -> list[Check]:
    """The rows, in the order of the table."""
    return [
        *lockstep_checks(),
        *refinement_checks(),
        *robustness_checks(),
        lens_check(),
        *odometry_checks(),
        *gravity_checks(),
        *stride_checks(),
        *map_checks(),
        *gap_checks(),
        *kidnapping_checks(),
        *localise_checks(),
        *lost_checks(),
        *faithful_checks(),
        *viewer_checks(),
        *robot_checks(),
        *frozen_checks(),
        *quota_checks(),
        *fuzz_checks(),
        *realtime_checks(),
        *growth_checks(),
        *kernel_checks(),
        *baseline_checks(),
        *paper_checks(),
        *gpu_checks(),
        *map_term_checks(),
        *bundle_adjustment_checks(),
        *rendering_checks(),
        *covariance_checks(),
        *field_error_checks(),
        *distance_checks(),
        *query_checks(),
        *merge_checks(),
        *texture_checks(),
        *peer_checks(),
        *fault_checks(),
        *soak_checks(),
        *batch_checks(),
    ]
