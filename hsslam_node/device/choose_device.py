"""Choose the device: CUDA if it works, else the CPU, with the reason."""

import importlib.util
from typing import Literal, NamedTuple, get_args

from hsslam_node.device.cuda_driver import OLDEST_DRIVER, driver_version, is_too_old
from hsslam_node.device.device import Device
from hsslam_node.device.gpu_memory import too_little_memory
from hsslam_node.device.triton_tools import keep_kernels, missing_tool
from hsslam_node.environment import TRITON_INTERPRET
from hsslam_node.errors import UserError, one_line

DeviceChoice = Literal["auto", "cpu", "cuda"]

_LARGEST_ERROR = 1e-4
_LONGEST = 200  # characters of an error that a message quotes


class _Missing(NamedTuple):
    """Why the GPU is not usable, and the remedy; empty if unknown."""

    what: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.what}: expected {self.remedy}" if self.remedy else self.what


def choose_device(choice: DeviceChoice, *, reproducible: bool = False) -> Device:
    """Choose the device; try CUDA with a small kernel. Imports torch only to look for a GPU.

    `auto` is the CPU if CUDA does not work, if the GPU has little free memory, or if `reproducible`: a GPU
    adds in another order each time.
    `cuda` under TRITON_INTERPRET=1 is Triton's interpreter: the same code, slowly, without a GPU.

    Raises:
        UserError: the choice is `cuda` and CUDA does not work, or the choice is unknown.
    """
    if choice not in (choices := get_args(DeviceChoice)):
        raise UserError(f"device {choice}: expected {', '.join(choices)}")
    if choice == "cpu":
        return Device("cpu", "CPU", "requested")
    if choice == "auto" and reproducible:
        return Device("cpu", "CPU", "lockstep is reproducible on the CPU only")
    if choice == "cuda" and TRITON_INTERPRET.value() == "1":
        return Device("interpreter", "Triton's interpreter", "TRITON_INTERPRET=1 is set")
    import torch

    if torch.version.cuda is None:
        what = f"PyTorch {torch.__version__} is built without CUDA"
        if choice == "auto":  # most users of this build have no GPU
            return Device("cpu", "CPU", f"no CUDA: {what}")
        raise _not_usable(_Missing(what, "PyTorch for CUDA"))
    missing = _what_is_missing()
    if choice == "cuda":
        if missing is not None:
            raise _not_usable(missing)
        return Device("cuda", torch.cuda.get_device_name(), "requested")
    if missing is not None:
        return Device("cpu", "CPU", f"no CUDA: {missing}")
    if full := too_little_memory(torch.cuda.mem_get_info()[0]):
        return Device("cpu", "CPU", full)
    return Device("cuda", torch.cuda.get_device_name(), "CUDA works")


def _not_usable(missing: _Missing) -> UserError:
    remedies = [missing.remedy, "--device cpu or auto"]
    return UserError(
        f"--device cuda: {missing.what}: expected {', or '.join(filter(None, remedies))}"
    )


def _what_is_missing() -> _Missing | None:
    """What PyTorch for CUDA lacks on this machine; None if a trial kernel gave the right numbers."""
    import torch

    if not torch.cuda.is_available():
        return _no_gpu(torch.__version__, driver_version())
    if importlib.util.find_spec("triton") is None:
        return _Missing("Triton is not installed", "the package triton")
    if TRITON_INTERPRET.value() == "1":
        return _Missing("TRITON_INTERPRET=1 interprets kernels", "TRITON_INTERPRET not set")
    keep_kernels()
    try:
        from hsslam_node.gpu_kernels.trial_kernel import trial_error

        error = trial_error("cuda")
    except Exception as failure:  # driver, compiler and Triton raise errors of many types
        if tool := missing_tool():  # not needed if Triton's cache has all
            return _Missing(*tool)
        return _Missing(f"a trial kernel fails: {_shortened(one_line(failure))}")
    if not error < _LARGEST_ERROR:
        return _Missing(f"a trial kernel is wrong by {error:.1g}")
    return None


def _no_gpu(torch_version: str, driver: str) -> _Missing:
    """The reason for a driver version; an empty one is unknown."""
    what = f"PyTorch {torch_version} finds no usable NVIDIA GPU"
    if is_too_old(driver):
        return _Missing(f"{what} with driver {driver}", f"driver {OLDEST_DRIVER} or newer")
    if driver:
        return _Missing(f"{what} with driver {driver}")
    return _Missing(f"{what} or driver", f"an NVIDIA driver, {OLDEST_DRIVER} or newer")


def _shortened(text: str) -> str:
    """The end of a long text: a compiler's command line comes first, its error last."""
    return text if len(text) <= _LONGEST else f"...{text[-_LONGEST:]}"
