"""Speed and accuracy on an NVIDIA GPU; where there is none, the reason stands in the table."""

from hsslam_node.services.bench.check import Check, Measured
from hsslam_node.services.bench.session import NotMeasured, Session


def gpu_checks() -> list[Check]:
    """The bounds of the GPU path."""
    of = "room, device cuda, one process"
    return [
        Check("gpu:paper", f"{of}, preset paper: frames a second", "20", _not_yet),
        Check("gpu:realtime", f"{of}, preset realtime: frames a second", "60", _not_yet),
        Check("gpu:kernels", "largest error of a kernel against float64", "1e-4", _not_yet),
    ]


def _not_yet(session: Session) -> Measured:
    import torch

    if not torch.cuda.is_available():
        raise NotMeasured("not measured: no CUDA device here")
    raise NotMeasured("not measured: there are no GPU kernels yet")
