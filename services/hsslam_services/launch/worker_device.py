"""The device of a process of a run, and who is told of it; alone, as few processes compute on one."""

import dataclasses

from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_services.governor.granted_cores import granted_cores
from hsslam_services.launch.worker import Worker


def worker_device(
    worker: Worker, *, warm_started: bool = False, after_the_last_frame: bool = False
) -> Device:
    """What the run's option comes to in this process.

    With `warm_started` a GPU's kernels are compiled and loaded now, not when a frame waits for them. A
    process that works `after_the_last_frame` has all cores that are granted. So has each in lockstep, as
    they compute one after the other. Otherwise a process has one core.

    Raises:
        UserError: CUDA is asked for and does not work; the run ends with that line.
    """
    in_lockstep = worker.options.pace == "lockstep"
    has_all = after_the_last_frame or in_lockstep
    threads = max(int(granted_cores()), 1) if has_all else 1
    device = choose_device(worker.options.device, reproducible=in_lockstep)
    device = dataclasses.replace(device, threads=threads)
    if warm_started and device.kind == "cuda":
        from hsslam_node.warm_start import warm_start

        warm_start(worker.options.slam, device)
    return device


def tell_device(worker: Worker, device: Device) -> None:
    """For one process of the run: an event for status line, log and viewer, and a section of the summary."""
    worker.event("info", f"the map is computed by {device}")
    if warning := not_reproducible(worker.options.pace, device):
        worker.event("warning", warning)
    worker.add_to_summary({"device": dataclasses.asdict(device)})


def not_reproducible(pace: str, device: Device) -> str | None:
    """The warning of a lockstep run whose result differs from run to run; None for all others."""
    if pace != "lockstep" or device.kind != "cuda":
        return None
    return "--device cuda: lockstep is not reproducible on a GPU: expected cpu or auto for equal results"
