"""What the metadata of installed packages says about PyTorch; the folders stand for site-packages."""

import sys
from pathlib import Path

import pytest

from hsslam_node.device.cuda_driver import has_cuda_driver
from hsslam_node.device.torch_build import cuda_torch_without_cuda


def _install(folder: Path, name: str, version: str, size: int = 0) -> None:
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
    (info / "RECORD").write_text(f"{name}/lib.so,sha256=0,{size}\n")


@pytest.fixture
def site_packages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    return tmp_path


@pytest.mark.skipif(has_cuda_driver(), reason="this machine has a CUDA driver")
@pytest.mark.parametrize("version", ["2.13.0", "2.13.0+cu130"])
def test_libraries_for_a_gpu_that_is_not_there_are_named_with_their_size(site_packages, version):
    _install(site_packages, "torch", version, 1_000_000_000)
    _install(site_packages, "nvidia-cublas", "13.1", 1_700_000_000)
    _install(site_packages, "triton", "3.7.1", 600_000_000)
    _install(site_packages, "numpy", "2.4.6", 60_000_000)
    line = cuda_torch_without_cuda()
    assert line is not None
    assert line.startswith(
        f"PyTorch {version} is the CUDA build, but this machine has no CUDA driver"
    )
    assert "free 2.3 GB: pip install torch==2.13.0+cpu --index-url https://" in line
    assert "\n" not in line


@pytest.mark.skipif(not has_cuda_driver(), reason="this machine has no CUDA driver")
def test_a_machine_with_a_driver_may_need_its_libraries(site_packages):
    _install(site_packages, "torch", "2.13.0")
    _install(site_packages, "nvidia-cublas", "13.1", 1_700_000_000)
    assert cuda_torch_without_cuda() is None


def test_the_cpu_build_is_fine_beside_triton(site_packages):
    _install(site_packages, "torch", "2.13.0+cpu")
    _install(site_packages, "triton", "3.7.1", 600_000_000)
    assert cuda_torch_without_cuda() is None


def test_a_build_of_one_s_own_without_libraries_is_fine(site_packages):
    _install(site_packages, "torch", "2.13.0")
    assert cuda_torch_without_cuda() is None


def test_without_pytorch_there_is_nothing_to_say(site_packages):
    assert cuda_torch_without_cuda() is None
