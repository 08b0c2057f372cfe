"""The version of the driver, as NVIDIA's two kernel modules tell it."""

from pathlib import Path

import pytest

from hsslam_node.device.cuda_driver import driver_version, is_too_old


@pytest.mark.parametrize(
    ("line", "version", "too_old"),
    [
        ("NVIDIA UNIX x86_64 Kernel Module  535.54.03  Tue Jun  6 22:20 UTC 2023", "535.54.03", True),
        ("NVIDIA UNIX Open Kernel Module for x86_64  580.65.06  Release Build", "580.65.06", False),
        ("NVIDIA UNIX Open Kernel Module for aarch64  555.58  Release Build", "555.58", True),
        ("of a kind that is not known", "", False),
    ],
)  # fmt: skip
def test_both_kinds_of_module_tell_it(tmp_path: Path, line: str, version: str, too_old: bool):
    file = tmp_path / "version"
    file.write_text(f"NVRM version: {line}\nGCC version:  gcc version 13.3.0\n")
    assert driver_version(file) == version
    assert is_too_old(version) == too_old


def test_without_the_file_it_is_not_known(tmp_path: Path):
    assert driver_version(tmp_path / "version") == ""
    (tmp_path / "version").touch()
    assert driver_version(tmp_path / "version") == ""
