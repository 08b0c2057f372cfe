"""Chooses and reports the device of a process; apart, as few processes compute on a device."""

import dataclasses

from hsslam_node.device.choose_device import choose_device
from hsslam_node.device.device import Device
from hsslam_services.governor.granted_cores import granted_cores
from hsslam_services.launch.worker import Worker


def worker_device(
    worker: Worker, *, warm_started: bool = False, after_the_last_frame: bool = False
) -> Device:
    """Choose the device of this process by `--device`.

    `warm_started`: compile and load the kernels of a GPU now, not when a frame waits for them. A process has
    one core. It has all granted cores if it works `after_the_last_frame`, or in lockstep, as processes
    then compute in turn.

    Raises:
        UserError: `--device cuda` and CUDA does not work; this ends the run.
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
    """Report the device as an event and in the summary; call this in one process of the run."""
    worker.event("info", f"the map is computed by {device}")
    if warning := not_reproducible(worker.options.pace, device):
        worker.event("warning", warning)
    worker.add_to_summary({"device": dataclasses.asdict(device)})


def not_reproducible(pace: str, device: Device) -> str | None:
    """A warning if the results of a lockstep run are not reproducible on this device; else None."""
    if pace != "lockstep" or device.kind != "cuda":
        return None
    return "--device cuda: lockstep is not reproducible on a GPU: expected cpu or auto for equal results"
