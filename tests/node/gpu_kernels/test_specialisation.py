"""A launch on a GPU finds its compiled kernel, whatever number of points or rays a frame brings."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator

import pytest
import torch

from tests.node.gpu_kernels.interpreter import import_gpu_kernels

import_gpu_kernels()
pytest.importorskip("triton")

from triton.backends.compiler import GPUTarget  # noqa: E402
from triton.compiler.compiler import make_backend  # noqa: E402
from triton.runtime.jit import JITFunction, create_function_from_signature  # noqa: E402

import hsslam_node.gpu_kernels as package  # noqa: E402

SIZES = {"n", "R", "W", "chunks", "blocks"}  # that vary from call to call
PARTS_OF_OTHERS = {"log_beta", "d_log_beta", "point_count"}  # they lie at any place of a tensor
CUBE = "mapping.smoothness"  # its n is a setting, and a factor in index arithmetic


def _kernels() -> Iterator[tuple[str, JITFunction]]:
    """All that are launched, as a GPU would have them compiled."""
    prefix = f"{package.__name__}."
    for module_info in pkgutil.walk_packages(package.__path__, prefix):
        module = importlib.import_module(module_info.name)
        source = inspect.getsource(module)
        for name, kernel in vars(module).items():
            if not hasattr(kernel, "fn") or not re.search(rf"\b{name}\[", source):
                continue
            if not isinstance(kernel, JITFunction):  # but of the interpreter
                kernel = JITFunction(kernel.fn, **kernel.kwargs)
            yield f"{module_info.name.removeprefix(prefix)}.{name}", kernel


def _key(kernel: JITFunction, size: int, shift: int) -> list[tuple]:
    """What Triton looks compiled kernels up by; `shift`: floats from an aligned place."""
    backend = make_backend(GPUTarget("cuda", 90, 32))
    binder = create_function_from_signature(kernel.signature, kernel.params, backend)
    values = torch.zeros(64)
    assert values.data_ptr() % 16 == 0
    arguments = []
    for parameter in kernel.params:
        if parameter.is_constexpr:
            arguments.append(16)
        elif parameter.name in SIZES:
            arguments.append(size)
        else:
            arguments.append(values[shift:] if parameter.name in PARTS_OF_OTHERS else values)
    return binder(*arguments)[1]


def test_sizes_and_parts_of_tensors_share_one_compiled_kernel():
    kernels = dict(_kernels())
    assert len(kernels) >= 17
    for name, kernel in kernels.items():
        first = _key(
            kernel, 1, 1
        )  # fails for names of arguments that Triton's launcher cannot take
        if not name.startswith(CUBE):
            assert first == _key(kernel, 17, 0) == _key(kernel, 2048, 1), name
