"""Where the GPU kernels run in tests: on the GPU, and without one in Triton's interpreter."""

import importlib
import os
import pkgutil
from typing import Any
from unittest.mock import patch

import torch

from hsslam_node.device.device import Device

DEVICE = "cuda" if torch.cuda.is_available() else "cpu"
GPU = Device("cuda" if DEVICE == "cuda" else "interpreter", DEVICE, "test")


def import_gpu_kernels() -> None:
    """Import Triton and all GPU kernels; without a GPU they become interpreted and take CPU tensors.

    Triton decides that as it decorates a function, so the variable is set for the import only, and
    no process that a test starts sees it.
    """
    settings = {} if DEVICE == "cuda" else {"TRITON_INTERPRET": "1"}
    with patch.dict(os.environ, settings):
        importlib.import_module("triton.experimental.gluon")  # else at the first launch
        package = importlib.import_module("hsslam_node.gpu_kernels")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    if settings:
        _patch_the_language_once_a_launch()
        _look_for_no_overflow()


def _patch_the_language_once_a_launch() -> None:
    """The interpreter exchanges the functions of `triton.language` at each launch, and again whenever a
    kernel calls a function: a third of its time, which for functions of ours changes nothing."""
    interpreted = importlib.import_module("triton.runtime.interpreter").InterpretedFunction
    patch_and_call = interpreted.__call__

    def call(function: Any, *args: Any, **kwargs: Any) -> Any:
        if function.fn.__module__.startswith("hsslam_node."):
            return function.rewrite()(*args, **kwargs)
        return patch_and_call(function, *args, **kwargs)

    interpreted.__call__ = call


def _look_for_no_overflow() -> None:
    """The interpreter computes each sum and product of int32 a second time in int64, and compares, for an
    assertion that it then leaves out as `debug` is off."""
    options = importlib.import_module("triton.runtime.interpreter").interpreter_builder.options
    assert not options.debug
    object.__setattr__(options, "sanitize_overflow", False)  # of a frozen class
