"""All rows of the benchmark's table, in its order."""

from hsslam_node.services.bench.check import Check
from hsslam_node.services.bench.kernel_checks import kernel_checks
from hsslam_node.services.bench.lockstep_checks import lockstep_checks
from hsslam_node.services.bench.realtime_checks import realtime_checks


def catalogue() -> list[Check]:
    """The rows; those that nobody can measure yet stand there as not measured."""
    return [
        *lockstep_checks(),
        *realtime_checks(),
        *kernel_checks(),
        Check("paper", "preset paper: accuracy and speed", "", None),
        Check("gpu", "device cuda: accuracy and speed", "", None),
    ]
