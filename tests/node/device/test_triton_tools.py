"""What a user is told who has a GPU and no compiler, and where compiled kernels go."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from hsslam_node.device.triton_tools import keep_kernels, missing_tool

VERSION = f"{sys.version_info[0]}.{sys.version_info[1]}"


@pytest.fixture
def compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The one program on PATH; CC is not set, and Python's headers are there."""
    program = tmp_path / "bin" / "gcc"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    (tmp_path / "Python.h").touch()
    monkeypatch.setenv("PATH", str(program.parent))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(sysconfig, "get_path", lambda *_: str(tmp_path))
    return program


def test_gcc_or_clang_or_what_cc_names_will_do(compiler: Path, monkeypatch: pytest.MonkeyPatch):
    assert missing_tool() is None
    other = compiler.rename(compiler.with_name("clang"))
    assert missing_tool() is None
    monkeypatch.setenv("CC", str(other.rename(other.with_name("mycc"))))
    assert missing_tool() is None
    packages = f"the packages gcc and python{VERSION}-dev"
    monkeypatch.setenv("CC", "icc")
    assert missing_tool() == ("Triton finds no C compiler (icc)", packages)
    monkeypatch.delenv("CC")
    assert missing_tool() == ("Triton finds no C compiler (gcc or clang)", packages)


def test_without_headers_the_package_is_named(compiler: Path, tmp_path: Path):
    (tmp_path / "Python.h").unlink()
    packages = f"the packages gcc and python{VERSION}-dev"
    assert missing_tool() == (f"Triton finds no Python.h in {tmp_path}", packages)


def test_kernels_lie_in_the_cache_unless_a_folder_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("TRITON_CACHE_DIR", "")  # and restored afterwards
    keep_kernels()
    assert os.environ["TRITON_CACHE_DIR"] == str(tmp_path / "hsslam" / "triton")
    monkeypatch.setenv("TRITON_CACHE_DIR", "elsewhere")
    keep_kernels()
    assert os.environ["TRITON_CACHE_DIR"] == "elsewhere"


def test_triton_follows(tmp_path: Path):
    """In a process of its own, as Triton may be imported here."""
    pytest.importorskip("triton")
    code = (
        "from triton import knobs; from hsslam_node.device.triton_tools import keep_kernels;"
        "keep_kernels(); print(knobs.cache.dir)"
    )
    environment = {k: v for k, v in os.environ.items() if k != "TRITON_CACHE_DIR"}
    environment["XDG_CACHE_HOME"] = str(tmp_path)
    done = subprocess.run([sys.executable, "-c", code], env=environment, check=True, stdout=-1)
    assert done.stdout.decode().strip() == str(tmp_path / "hsslam" / "triton")
