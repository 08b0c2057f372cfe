"""Installs HS-SLAM from the lock into a virtual environment, with the PyTorch that fits the machine.

python requirements/install.py [--venv FOLDER] [--dev] [--ros2] [--editable] [PROJECT]

`make run`, `make test` and the images use it. uv does the work if it is on PATH, else pip.
TORCH=cpu|cuda decides which PyTorch; else a machine with a CUDA driver that it can use gets that of PyPI,
any other PyTorch's CPU wheel. TORCH_INDEX=URL names a mirror of PyTorch's index of CPU wheels. Every
package must have one of the hashes in its lock, wherever it comes from.

It stands beside the locks, as nothing of it is needed after installation, and wants no package.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LOCKS = ROOT / "requirements"
sys.path.insert(0, str(LOCKS))

from torch_index import CPU_INDEX  # noqa: E402

_ANSWER_WITHIN_S = 5.0
_OLDEST, _NEWEST = (3, 11), (3, 14)
_OLDEST_GLIBC = (2, 28)
_PIP = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
# pip would compile all of torch, numba and the others, and wait; Python compiles what it imports
_PIP.append("--no-compile")


def main() -> None:
    """Ends with one line if this machine, its Python or an option does not fit."""
    options = _options()
    wish = wanted_torch(os.environ)
    python = options.venv / "bin" / "python"
    if Path(sys.prefix).resolve() != options.venv.resolve():
        if not python.exists():
            _check_machine()
            _make_environment(options.venv)
        # the rest runs in the environment itself: a user may have made it with another Python
        os.execv(python, [str(python), str(Path(__file__).resolve()), *sys.argv[1:]])
    _check_machine()
    locks = locks_of(options)
    tool = _tool()
    _echo(f"{' and '.join(locks)} with {'pip' if tool is _PIP else 'uv'}")
    required = [word for lock in locks for word in ("--requirement", str(LOCKS / lock))]
    _run([*tool, "--require-hashes", *required])
    install_torch(tool, wish, options.venv)
    _run([*tool, "--no-deps", *(["--editable"] if options.editable else []), options.project])


def locks_of(options: argparse.Namespace) -> list[str]:
    """The locks whose packages are wanted; dev.lock has those of ros2.lock."""
    if options.dev:
        return ["dev.lock"]
    return ["base.lock", "ros2.lock"] if options.ros2 else ["base.lock"]


def wanted_torch(environment: dict[str, str] | os._Environ[str]) -> str:
    """`cpu` or `cuda` as TORCH says, or else `auto`."""
    wish = environment.get("TORCH") or "auto"
    if wish not in ("auto", "cpu", "cuda"):
        sys.exit(f"install: TORCH={wish}: cpu or cuda is expected")
    return wish


def install_torch(tool: list[str], wish: str, venv: Path, locks: Path = LOCKS) -> None:
    """PyTorch and what only it brings, of the build that the wish or the machine asks for, from the folder
    with torch_cpu.lock and torch_cuda.lock; in place: left alone.
    """
    release = torch_requirement().partition("==")[2]
    installed = _installed_torch()
    if installed and installed.partition("+")[0] == release:
        build = "cpu" if installed.endswith("+cpu") else "cuda"
        if wish not in ("auto", build):
            sys.exit(
                f"install: TORCH={wish}: {venv} holds PyTorch {installed}: remove {venv} first"
            )
        return
    build, reason = choose_torch(wish)
    locked = ["--no-deps", "--require-hashes", "--requirement"]  # base.lock has the rest
    with_cuda = [*locked, str(locks / "torch_cuda.lock")]
    if build == "cuda":
        _echo(f"PyTorch {release} with CUDA, as {reason}")
        _run([*tool, *with_cuda])
        return
    index = os.environ.get("TORCH_INDEX") or CPU_INDEX
    _echo(f"PyTorch {release} for the CPU, as {reason}")
    for_cpu = [*locked, str(locks / "torch_cpu.lock")]
    trouble = why_unreachable(index)
    if trouble is None:
        if not _failed([*tool, *_also_from(tool, index), *for_cpu]):
            return
        trouble = "the installation from there failed"
    _echo(
        f"{index}: {trouble}: takes the wheel for the CPU that pip's settings find, or else the build with "
        "CUDA, 2.5 GB more"
    )
    if _failed([*_pip(tool), *for_cpu], is_quiet=True):
        _run([*tool, *with_cuda])


def _also_from(tool: list[str], index: str) -> list[str]:
    """Options that add an index to the one of PyPI; the hashes decide which of them has a package."""
    if tool is _PIP:
        return ["--extra-index-url", index]
    return ["--index", index, "--index-strategy", "unsafe-best-match"]


def torch_requirement() -> str:
    """The one line of torch.txt: `torch==X.Y.Z`."""
    lines = (LOCKS / "torch.txt").read_text().splitlines()
    (line,) = [line for line in lines if line and not line.startswith("#")]
    return line


def choose_torch(wish: str) -> tuple[str, str]:
    """The build, `cpu` or `cuda`, and the reason, to go on from "as"."""
    if wish != "auto":
        return wish, f"TORCH={wish} is set"
    sys.path.insert(0, str(ROOT))
    from hsslam_node.device.cuda_driver import driver_version, has_cuda_driver, newest_cuda

    return fitting_torch(has_cuda_driver(), driver_version(), newest_cuda())


def fitting_torch(has_driver: bool, version: str, cuda: int) -> tuple[str, str]:
    """The same by the CUDA driver, its version, empty if not known, as on WSL and Jetson, and the newest CUDA
    that it runs, such as 12060; 0: not known."""
    from hsslam_node.device.cuda_driver import OLDEST_CUDA, OLDEST_DRIVER, is_too_old

    if not has_driver:
        return "cpu", "this machine has no CUDA driver (TORCH=cuda decides otherwise)"
    driver = f"CUDA driver {version}".strip()
    if is_too_old(version):
        needed = f"{OLDEST_DRIVER} or newer is needed (TORCH=cuda decides otherwise)"
        return "cpu", f"this machine has {driver}, and {needed}"
    if not version and cuda < OLDEST_CUDA:
        known = f"for CUDA {cuda // 1000}.{cuda % 1000 // 10}" if cuda else "of unknown version"
        needed = (
            f"one for CUDA {OLDEST_CUDA // 1000} or newer is needed (TORCH=cuda decides otherwise)"
        )
        return "cpu", f"this machine has a driver {known}, and {needed}"
    return "cuda", f"this machine has {driver} (TORCH=cpu decides otherwise)"


def why_unreachable(index: str, within_s: float = _ANSWER_WITHIN_S) -> str | None:
    """None if a package index answers in time, else why not. No second try.

    A thread, as the time limit of a connection does not hold for the search for its address.
    """
    outcome: list[str | None] = [f"no answer within {within_s:.0f} s"]

    def ask() -> None:
        try:
            urllib.request.urlopen(f"{index.rstrip('/')}/torch/", timeout=within_s).close()
            outcome[0] = None
        except (OSError, ValueError) as error:
            outcome[0] = str(getattr(error, "reason", None) or error) or type(error).__name__

    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    asking.join(within_s)
    return outcome[0]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Installs HS-SLAM from the lock.")
    parser.add_argument("--venv", type=Path, default=Path(".venv"), help="made if it is not there")
    parser.add_argument("--dev", action="store_true", help="also what the tests need")
    parser.add_argument("--ros2", action="store_true", help="also cameras in ROS 2, and ROS bags")
    parser.add_argument("--editable", action="store_true", help="run from the sources as they are")
    parser.add_argument("project", nargs="?", default=str(ROOT), help="folder, wheel or sdist")
    return parser.parse_args()


def _check_machine() -> None:
    """Ends with one line where the packages of the lock have no wheels."""
    version = sys.version_info[:2]
    if not _OLDEST <= version <= _NEWEST:
        sys.exit(
            f"install: {sys.executable} is Python {version[0]}.{version[1]}; 3.11 to 3.14 is needed: "
            "make PYTHON=python3.12 ..., or with uv: uv venv --python 3.12 .venv"
        )
    system, machine = platform.system(), platform.machine()
    if system != "Linux" or machine not in ("x86_64", "aarch64"):
        sys.exit(f"install: {system} {machine}: Linux on x86-64 or aarch64 is needed")
    libc, number = platform.libc_ver()
    if libc != "glibc" or tuple(map(int, number.split(".")[:2])) < _OLDEST_GLIBC:
        found = f"{libc or 'another C library'} {number}".strip()
        sys.exit(f"install: {found}: glibc 2.28 or newer is needed (Ubuntu 20.04, Debian 11)")


def _make_environment(venv: Path) -> None:
    uv = shutil.which("uv")
    if uv:  # with pip, as users expect it there
        _run([uv, "venv", "--quiet", "--seed", "--python", sys.executable, str(venv)])
    elif _failed([sys.executable, "-m", "venv", str(venv)]):
        shutil.rmtree(venv, ignore_errors=True)
        sys.exit("install: no virtual environment: on Debian and Ubuntu, apt install python3-venv")


def _tool() -> list[str]:
    """The command that installs into this environment."""
    uv = shutil.which("uv")
    if uv:
        return [uv, "pip", "install", "--quiet", "--python", sys.executable]
    return _PIP


def _pip(tool: list[str]) -> list[str]:
    """pip, whose settings may know more than one index, or else the tool."""
    return _PIP if importlib.util.find_spec("pip") else tool


def _installed_torch() -> str | None:
    try:
        return importlib.metadata.version("torch")
    except importlib.metadata.PackageNotFoundError:
        return None


def _failed(command: list[str], is_quiet: bool = False) -> bool:
    return subprocess.run(command, check=False, capture_output=is_quiet).returncode != 0


def _run(command: list[str]) -> None:
    if _failed(command):
        sys.exit(f"install: failed: {' '.join(command)}")


def _echo(text: str) -> None:
    print(f"install: {text}", flush=True)


if __name__ == "__main__":
    main()
