"""What can be known without a GPU: each choice ends in a device that works, or in one line."""

import os
import subprocess
import sys

import pytest
import torch

from hsslam_node.device.choose_device import choose_device
from hsslam_node.errors import UserError

without_cuda = pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")


def test_the_cpu_is_chosen_without_importing_torch():
    code = (
        "import sys; from hsslam_node.device.choose_device import choose_device;"
        "assert choose_device('cpu').kind == 'cpu'; assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_auto_is_the_cpu_where_results_are_to_be_equal():
    device = choose_device("auto", reproducible=True)
    assert str(device) == "CPU: lockstep is reproducible on the CPU alone"


@without_cuda
def test_auto_takes_the_cpu_and_says_why(monkeypatch):
    for interpreted in ("0", "1"):
        monkeypatch.setenv("TRITON_INTERPRET", interpreted)
        device = choose_device("auto")
        assert device.kind == "cpu" and not device.uses_triton
        assert device.reason.startswith("no CUDA: ") and torch.__version__ in device.reason
        assert "\n" not in str(device)


@without_cuda
def test_cuda_that_does_not_work_is_one_line(monkeypatch):
    monkeypatch.delenv("TRITON_INTERPRET", raising=False)
    with pytest.raises(UserError) as caught:
        choose_device("cuda")
    text = str(caught.value)
    assert text.startswith("--device cuda: ") and torch.__version__ in text
    assert "--device cpu" in text and "\n" not in text


def test_the_interpreter_is_taken_only_when_asked_for(monkeypatch):
    monkeypatch.setenv("TRITON_INTERPRET", "1")
    device = choose_device("cuda")
    assert device.kind == "interpreter" and device.uses_triton and device.tensors_on == "cpu"


def test_the_trial_kernel_gives_the_right_numbers():
    """In an interpreter of its own: kernels are interpreted or compiled as they are first imported."""
    code = (
        "from hsslam_node.gpu_kernels.trial_kernel import trial_error;"
        "error = trial_error('cpu'); assert error < 1e-5, error"
    )
    pytest.importorskip("triton")
    subprocess.run([sys.executable, "-c", code], check=True, env=_interpreted())


def _interpreted() -> dict[str, str]:
    return {**os.environ, "TRITON_INTERPRET": "1"}
