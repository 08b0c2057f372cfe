"""Who is told that a run on a GPU is not reproducible."""

import pytest

from hsslam_node.device.device import CPU, Device
from hsslam_services.launch.worker_device import not_reproducible

GPU = Device("cuda", "a GPU", "asked for")


@pytest.mark.parametrize(
    ("pace", "device", "is_told"),
    [("lockstep", GPU, True), ("lockstep", CPU, False), ("realtime", GPU, False)],
)
def test_a_lockstep_run_on_a_gpu_is_warned_of(pace: str, device: Device, is_told: bool):
    warning = not_reproducible(pace, device)
    assert (warning is not None) == is_told
    assert not warning or (warning.startswith("--device cuda: ") and "cpu or auto" in warning)
