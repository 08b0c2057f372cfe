"""The device that a process of a run computes on."""

import dataclasses

from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_node.services.summary import update_summary
from hsslam_node.services.worker import Worker


def worker_device(worker: Worker, *, rehearsed: bool = False) -> Device:
    """What the run's option comes to in this process.

    With `rehearsed` a GPU's kernels are compiled and loaded now, not when a frame waits for them.

    Raises:
        UserError: CUDA is asked for and does not work; the run ends with that line.
    """
    device = choose_device(worker.options.device)
    if rehearsed and device.kind == "cuda":
        from hsslam_node.rehearsal import rehearse

        rehearse(worker.options.slam, device)
    return device


def tell_device(worker: Worker, device: Device) -> None:
    """For one process of the run: an event for status line, log and viewer, and a line of the summary."""
    worker.event("info", f"the map is computed by {device}")
    update_summary(worker.run.path, {"device": dataclasses.asdict(device)})
