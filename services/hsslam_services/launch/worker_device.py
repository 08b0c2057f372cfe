"""The device of a process of a run, and who is told of it; alone, as few processes compute on one."""

import dataclasses

from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_services.governor.granted_cores import granted_cores
from hsslam_services.launch.worker import Worker


def worker_device(worker: Worker, *, warm_started: bool = False) -> Device:
    """What the run's option comes to in this process.

    With `warm_started` a GPU's kernels are compiled and loaded now, not when a frame waits for them. In
    lockstep, where one process computes at a time, it has all cores that are granted, else one.

    Raises:
        UserError: CUDA is asked for and does not work; the run ends with that line.
    """
    threads = max(int(granted_cores()), 1) if worker.options.pace == "lockstep" else 1
    device = dataclasses.replace(choose_device(worker.options.device), threads=threads)
    if warm_started and device.kind == "cuda":
        from hsslam_node.warm_start import warm_start

        warm_start(worker.options.slam, device)
    return device


def tell_device(worker: Worker, device: Device) -> None:
    """For one process of the run: an event for status line, log and viewer, and a section of the summary."""
    worker.event("info", f"the map is computed by {device}")
    worker.add_to_summary({"device": dataclasses.asdict(device)})
