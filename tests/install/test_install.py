"""The installer at work in an environment of its own, with small stand-ins for PyTorch's wheels."""

import _json
import functools
import hashlib
import http.server
import os
import shutil
import socket
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from hsslam_node.device.cuda_driver import (
    OLDEST_CUDA,
    driver_version,
    has_cuda_driver,
    is_too_old,
    newest_cuda,
)
from requirements.install import fitting_torch, torch_requirement, why_unreachable

ROOT = Path(__file__).parents[2]
_RELEASE = torch_requirement().partition("==")[2]
_INSTALL_TORCH = f"""
import os, sys
from pathlib import Path
sys.path.insert(0, {str(ROOT)!r})
from requirements.install import _tool, install_torch, wanted_torch
install_torch(_tool(), wanted_torch(os.environ), Path(sys.prefix), Path(sys.argv[1]))
"""


def _wheel(folder: Path, name: str, version: str, content: str = "") -> str:
    """An empty package of a version, as a wheel; its SHA-256."""
    folder = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    info = f"{name}-{version}.dist-info"
    path = folder / f"{name}-{version}-py3-none-any.whl"
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr(zipfile.ZipInfo(f"{name}/__init__.py"), content)
        for file, text in (
            ("METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"),
            ("WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"),
            ("RECORD", f"{info}/METADATA,,\n{info}/RECORD,,\n"),
        ):
            wheel.writestr(zipfile.ZipInfo(f"{info}/{file}"), text)
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def served(tmp_path_factory) -> Iterator[tuple[str, Path]]:
    """The address of package indexes, and the folder of the locks that fit them.

    `/pypi` also has a CPU wheel, and a newer sympy than `/cpu`; `/cuda` has none; `/forged` has another wheel
    of the same version.
    """
    folder = tmp_path_factory.mktemp("indexes")
    needed = _wheel(folder / "pypi", "sympy", "1.14.0")
    _wheel(folder / "cpu", "sympy", "1.13.3")
    build = _wheel(folder / "pypi", "torch", _RELEASE)
    cpu_build = _wheel(folder / "pypi", "torch", f"{_RELEASE}+cpu")
    assert _wheel(folder / "cpu", "torch", f"{_RELEASE}+cpu") == cpu_build
    assert _wheel(folder / "forged", "torch", f"{_RELEASE}+cpu", "import os") != cpu_build
    (folder / "empty" / "torch").mkdir(parents=True)
    _wheel(folder / "cuda", "torch", _RELEASE)
    _wheel(folder / "cuda", "sympy", "1.14.0")
    also = f"sympy==1.14.0 --hash=sha256:{needed}\n"
    lines = {
        "torch_cuda.lock": f"torch==={_RELEASE} --hash=sha256:{build}\n",
        "torch_cpu.lock": f"torch=={_RELEASE}+cpu --hash=sha256:{cpu_build}\n",
    }
    for name, line in lines.items():
        (folder / name).write_text(line + also)
    handler = functools.partial(_Quiet, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}", folder
        server.shutdown()


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Path:
    """An environment with pip alone."""
    folder = tmp_path_factory.mktemp("fresh") / "venv"
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    return folder


@pytest.fixture
def environment(fresh: Path) -> Iterator[Path]:
    """The environment without PyTorch."""
    yield fresh
    for name in ("torch", "sympy"):
        for left in fresh.glob(f"lib/python*/site-packages/{name}*"):
            shutil.rmtree(left)


@pytest.fixture(params=["pip", "uv"])
def tool_path(request, tmp_path: Path) -> str:
    """PATH with or without uv, which `make resolve` leaves in build/."""
    uv = shutil.which("uv") or shutil.which(ROOT / "build/uv/bin/uv")
    if request.param == "uv":
        if not uv:
            pytest.skip("no uv on PATH and none of `make resolve`")
        (tmp_path / "uv").symlink_to(uv)
    return f"{tmp_path}:/usr/bin:/bin"


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


def _refusing() -> str:
    """An index at a port where nothing listens."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        return f"http://127.0.0.1:{server.getsockname()[1]}"


def _install(
    environment: Path, served: tuple[str, Path], path: str, **settings: str
) -> tuple[int, list[str]]:
    """Exit code and lines of the installer's step for PyTorch, with `/pypi` in PyPI's place."""
    indexes, locks = served
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("PIP_", "UV_", "TORCH"))}
    ours = {
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": f"{indexes}/pypi",
        "UV_NO_CONFIG": "1",
        "UV_DEFAULT_INDEX": f"{indexes}/pypi",
        "TORCH_INDEX": f"{indexes}/cpu",
        "PATH": path,
    }
    done = subprocess.run(
        [environment / "bin" / "python", "-c", _INSTALL_TORCH, locks],
        env=kept | ours | settings,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout.splitlines()


def _version(environment: Path, name: str = "torch") -> str:
    (info,) = environment.glob(f"lib/python*/site-packages/{name}-*.dist-info")
    return info.name.removeprefix(f"{name}-").removesuffix(".dist-info")


def test_cpu_takes_the_wheel_of_pytorch_s_index(environment, served, tool_path):
    code, lines = _install(environment, served, tool_path, TORCH="cpu")
    assert (code, lines) == (0, [f"install: PyTorch {_RELEASE} for the CPU, as TORCH=cpu is set"])
    assert _version(environment) == f"{_RELEASE}+cpu"
    assert _version(environment, "sympy") == "1.14.0"  # which that index does not have


def test_cuda_takes_the_build_of_pypi_though_a_cpu_wheel_counts_as_newer(
    environment, served, tool_path
):
    code, lines = _install(environment, served, tool_path, TORCH="cuda")
    assert (code, lines) == (0, [f"install: PyTorch {_RELEASE} with CUDA, as TORCH=cuda is set"])
    assert _version(environment) == _RELEASE


def test_the_machine_decides_unless_a_user_does(environment, served, tool_path):
    code, (line,) = _install(environment, served, tool_path)
    assert code == 0
    is_known = bool(driver_version()) or newest_cuda() >= OLDEST_CUDA
    is_fit = has_cuda_driver() and is_known and not is_too_old(driver_version())
    assert ("with CUDA, as this machine has CUDA driver" in line) == is_fit
    assert _version(environment) == (_RELEASE if is_fit else f"{_RELEASE}+cpu")


def test_the_driver_s_library_makes_it_a_machine_for_cuda(environment, served, tool_path, tmp_path):
    shutil.copy(_json.__file__, tmp_path / "libcuda.so.1")  # any library that can be loaded
    _, (line,) = _install(environment, served, tool_path, LD_LIBRARY_PATH=str(tmp_path))
    assert "this machine has a driver of unknown version" in line or "has CUDA driver" in line


@pytest.mark.parametrize(
    ("version", "cuda", "build", "reason"),
    [
        (
            "535.54.03",
            12020,
            "cpu",
            "CUDA driver 535.54.03, and 580 or newer is needed (TORCH=cuda ",
        ),
        ("580.65.06", 13000, "cuda", "CUDA driver 580.65.06 (TORCH=cpu "),
        ("", 13000, "cuda", "CUDA driver (TORCH=cpu "),  # WSL, Jetson
        (
            "",
            12060,
            "cpu",
            "a driver for CUDA 12.6, and one for CUDA 13 or newer is needed (TORCH=cuda ",
        ),
        (
            "",
            0,
            "cpu",
            "a driver of unknown version, and one for CUDA 13 or newer is needed (TORCH=cuda ",
        ),
    ],
)
def test_a_driver_that_pytorch_cannot_use_brings_no_large_download(
    version: str, cuda: int, build: str, reason: str
):
    end = "decides otherwise)"
    assert fitting_torch(True, version, cuda) == (build, f"this machine has {reason}{end}")


@pytest.mark.parametrize("index", [_refusing, lambda: "http://no.such.host.invalid", lambda: "cpu"])
def test_an_index_out_of_reach_costs_one_line_and_no_wait(environment, served, tool_path, index):
    began = time.monotonic()
    address = index()
    code, lines = _install(environment, served, tool_path, TORCH="cpu", TORCH_INDEX=address)
    assert time.monotonic() - began < 20  # pip alone takes 2 s; its retries would take minutes
    assert code == 0
    assert len(lines) == 2
    assert lines[1].startswith(f"install: {address}: ")
    assert "takes the wheel for the CPU that pip's settings find, or else" in lines[1]
    assert _version(environment) == f"{_RELEASE}+cpu"  # /pypi has one


def test_without_any_wheel_for_the_cpu_the_build_with_cuda_is_installed(
    environment, served, tool_path
):
    indexes, _ = served
    code, lines = _install(
        environment, served, tool_path, TORCH="cpu", TORCH_INDEX=_refusing(),
        PIP_INDEX_URL=f"{indexes}/cuda", UV_DEFAULT_INDEX=f"{indexes}/cuda",
    )  # fmt: skip
    assert code == 0 and len(lines) == 2  # nothing of pip's own
    assert _version(environment) == _RELEASE


def test_an_index_without_the_wheel_is_as_good_as_none(environment, served, tool_path):
    empty = f"{served[0]}/empty"
    code, _ = _install(environment, served, tool_path, TORCH="cpu", TORCH_INDEX=empty)
    assert code == 0
    assert _version(environment) == f"{_RELEASE}+cpu"  # /pypi has it, too


def test_a_wheel_with_another_hash_is_not_installed(environment, served, tool_path):
    forged = f"{served[0]}/forged"
    only_cuda = f"{served[0]}/empty"
    code, lines = _install(
        environment, served, tool_path, TORCH="cpu", TORCH_INDEX=forged,
        PIP_INDEX_URL=only_cuda, UV_DEFAULT_INDEX=only_cuda,
    )  # fmt: skip
    assert code == 1
    assert any("the installation from there failed" in line for line in lines)
    assert not list(environment.glob("lib/python*/site-packages/torch*"))


def test_an_index_that_never_answers_is_given_up():
    with socket.create_server(("127.0.0.1", 0)) as server:
        began = time.monotonic()
        reason = why_unreachable(f"http://127.0.0.1:{server.getsockname()[1]}", within_s=1.0)
        assert time.monotonic() - began < 3
    assert reason in ("no answer within 1 s", "timed out")


def test_an_index_that_answers_is_reached(served):
    indexes, _ = served
    assert why_unreachable(f"{indexes}/cpu/") is None
    assert why_unreachable(f"{indexes}/nothing") == "File not found"


def test_pytorch_in_place_is_left_alone_or_named_as_the_wrong_one(environment, served, tool_path):
    _install(environment, served, tool_path, TORCH="cpu")
    assert _install(environment, served, tool_path) == (0, [])
    assert _install(environment, served, tool_path, TORCH="cpu") == (0, [])
    code, (line,) = _install(environment, served, tool_path, TORCH="cuda")
    assert code == 1
    assert line.startswith(
        f"install: TORCH=cuda: {environment} holds PyTorch {_RELEASE}+cpu: remove"
    )


@pytest.mark.parametrize("wish", ["gpu", "CPU", "cpu "])
def test_a_wrong_wish_ends_before_anything_is_made(tmp_path, wish):
    done = subprocess.run(
        [sys.executable, ROOT / "requirements/install.py", "--venv", tmp_path / "venv"],
        env=os.environ | {"TORCH": wish},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr == f"install: TORCH={wish}: cpu or cuda is expected\n"
    assert not (tmp_path / "venv").exists()
