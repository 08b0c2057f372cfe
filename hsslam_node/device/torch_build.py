"""Which build of PyTorch is installed, from package metadata, without importing PyTorch."""

from collections.abc import Iterable
from importlib.metadata import Distribution, PackageNotFoundError, distribution, distributions

from hsslam_node.device.cuda_driver import has_cuda_driver

_CPU_INDEX = "https://download.pytorch.org/whl/cpu"
_REMOVE = "pip uninstall -y $(pip freeze | grep -oE '^(nvidia-|cuda-|triton)[^=]*')"


def cuda_torch_without_cuda() -> str | None:
    """A notice if PyTorch is the CUDA build and this machine has no CUDA driver, else None.

    Takes 0.1 s on such a machine, 1 ms elsewhere.
    """
    try:
        version = distribution("torch").version
    except PackageNotFoundError:
        return None
    release, _, tag = version.partition("+")
    if tag == "cpu" or has_cuda_driver():
        return None
    libraries = [d for d in distributions() if _is_cuda(d)]
    if not libraries and not tag.startswith("cu"):
        return None
    return (
        f"PyTorch {version} is the CUDA build, but this machine has no CUDA driver: "
        f"free {_installed_gb(libraries):.1f} GB: "
        f"pip install torch=={release}+cpu --index-url {_CPU_INDEX} && {_REMOVE}"
    )


def _is_cuda(package: Distribution) -> bool:
    """Whether only PyTorch's CUDA build needs this package."""
    name = (package.metadata["Name"] or "").lower()
    return name == "triton" or name.startswith(("nvidia-", "cuda-"))


def _installed_gb(packages: Iterable[Distribution]) -> float:
    """Size in GB of all files of these packages, from their RECORDs."""
    return sum(file.size or 0 for d in packages for file in d.files or ()) / 1e9
