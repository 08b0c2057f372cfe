"""The choice of the device: CUDA if it really works, else the CPU with the reason."""

import importlib.util
from typing import Literal

from hsslam_node.device.device import Device
from hsslam_node.environment import TRITON_INTERPRET
from hsslam_node.errors import UserError

DeviceChoice = Literal["auto", "cpu", "cuda"]

_LARGEST_ERROR = 1e-4
_REMEDY = (
    "choose --device cpu or auto, or install PyTorch for CUDA, and gcc with the headers of Python, "
    "beside an NVIDIA driver"
)


def choose_device(choice: DeviceChoice, *, reproducible: bool = False) -> Device:
    """The device to compute with, tried out. Imports torch unless the choice is the CPU.

    With `reproducible`, `auto` is the CPU: a GPU adds in another order each time.
    `cuda` under TRITON_INTERPRET=1 is Triton's interpreter: the same code, slowly, without a GPU.

    Raises:
        UserError: `cuda` is asked for and does not work.
    """
    if choice == "cpu":
        return Device("cpu", "CPU", "asked for")
    if choice == "auto" and reproducible:
        return Device("cpu", "CPU", "lockstep is reproducible on the CPU alone")
    if choice == "cuda" and TRITON_INTERPRET.value() == "1":
        return Device("interpreter", "Triton's interpreter", "TRITON_INTERPRET=1 is set")
    missing = _what_is_missing()
    if missing is None:
        import torch

        reason = "asked for" if choice == "cuda" else "CUDA works"
        return Device("cuda", torch.cuda.get_device_name(), reason)
    if choice == "cuda":
        raise UserError(f"--device cuda: {missing}: {_REMEDY}")
    return Device("cpu", "CPU", f"no CUDA: {missing}")


def _what_is_missing() -> str | None:
    """Why the GPU cannot be used, in one line; None where a kernel ran and gave the right numbers."""
    import torch

    if torch.version.cuda is None:
        return f"this PyTorch ({torch.__version__}) is built without it"
    if not torch.cuda.is_available():
        return f"PyTorch {torch.__version__} finds no usable NVIDIA GPU or driver"
    if importlib.util.find_spec("triton") is None:
        return "Triton is not installed"
    if TRITON_INTERPRET.value() == "1":
        return "TRITON_INTERPRET=1 is set, so that kernels would be interpreted"
    try:
        from hsslam_node.gpu_kernels.trial_kernel import trial_error

        error = trial_error("cuda")
    except Exception as failure:  # driver, compiler and Triton raise errors of many types
        text = " ".join(str(failure).split())[:200]
        return f"a trial kernel fails: {type(failure).__name__}: {text}"
    if not error < _LARGEST_ERROR:
        return f"a trial kernel is wrong by {error:.1g}"
    return None
