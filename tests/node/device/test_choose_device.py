"""What can be known without a GPU: each choice ends in a device that works, or in one line."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
import torch

from hsslam_node.device.choose_device import _no_gpu, _shortened, choose_device
from hsslam_node.errors import UserError
from hsslam_node.presets import REALTIME
from hsslam_node.slam import Slam
from hsslam_node.warm_start import textured_wall

without_cuda = pytest.mark.skipif(torch.cuda.is_available(), reason="this machine has CUDA")


def test_the_cpu_is_chosen_without_importing_torch():
    code = (
        "import sys; from hsslam_node.device.choose_device import choose_device;"
        "assert choose_device('cpu').kind == 'cpu'; assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_auto_is_the_cpu_where_results_are_to_be_equal():
    device = choose_device("auto", reproducible=True)
    assert str(device) == "CPU: lockstep is reproducible on the CPU only"


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
    assert text.endswith(", or --device cpu or auto") and "\n" not in text


@pytest.mark.parametrize(
    ("driver", "line"),
    [
        ("535.54.03", "no usable NVIDIA GPU with driver 535.54.03: expected driver 580 or newer"),
        ("580.65.06", "no usable NVIDIA GPU with driver 580.65.06"),
        ("", "no usable NVIDIA GPU or driver: expected an NVIDIA driver, 580 or newer"),
    ],
)
def test_a_gpu_that_is_not_found_is_told_with_its_driver(driver: str, line: str):
    assert str(_no_gpu("2.13.0", driver)) == f"PyTorch 2.13.0 finds {line}"


def test_of_a_long_error_the_end_is_told():
    command = "CalledProcessError: Command '['/usr/bin/gcc', " + "'-I/a/folder', " * 30
    told = _shortened(f"{command}]' returned non-zero exit status 1.")
    assert len(told) < 220 and told.endswith("returned non-zero exit status 1.")


def test_the_library_takes_the_name_of_a_device_as_well():
    config = replace(REALTIME, mapper=replace(REALTIME.mapper, first_iterations=1))
    slam = Slam(config, device="cpu")
    assert slam.process(next(textured_wall(1))).status == "initial"
    with pytest.raises(UserError, match=r"^device gpu: expected auto, cpu, cuda$"):
        Slam(config, device="gpu")  # type: ignore[arg-type]


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
