"""Writes the locks, or checks that they fit pyproject.toml, torch.txt and batch_image.txt.

python requirements/lock.py UV [--check | --upgrade]

A lock lists packages with versions and hashes, for every platform and Python 3.11 or newer:

- base.lock and dev.lock: everything but PyTorch and what only PyTorch brings
- ros2.lock: what the extra ros2 adds to base.lock
- batch.lock: what the extra batch and batch_image.txt add to base.lock
- torch_cuda.lock and torch_cpu.lock: PyTorch, in one of its builds, and what it adds to base.lock

Pins stay as they are until --upgrade. The settings of pip and uv are ignored: the packages are those of
PyPI, as everybody gets them. PyPI lacks PyTorch's wheels for the CPU; their hashes are read from PyTorch's
index when torch.txt has another version.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import urllib.request
from pathlib import Path

from torch_index import CPU_INDEX, cpu_wheels

ROOT = Path(__file__).parents[1]
FOLDER = Path("requirements")  # relative, as the locks name their sources
LOCKS = {  # name: what it adds to the base
    "base.lock": [],
    "dev.lock": ["--extra", "dev"],
    "ros2.lock": ["--extra", "ros2"],
    "batch.lock": ["--extra", "batch", str(FOLDER / "batch_image.txt")],
}

_HEADER = """\
# Made by `make lock` from {}: change those, not this.
# {}
"""
_FROM = "pyproject.toml and torch.txt"
_ALL = "Everything but PyTorch and what only PyTorch brings."
_TORCH = FOLDER / "torch.txt"
_BUILDS = {
    "torch_cuda.lock": "PyTorch with CUDA, from PyPI, and what it adds to base.lock.",
    "torch_cpu.lock": "PyTorch for the CPU, from its own index, and what it adds to base.lock.",
}
_TORCH_ENTRY = re.compile(r"^torch==([\w.]+) \\\n(?:    --hash=\S+(?: \\)?\n)+", re.MULTILINE)
_OF_CUDA = re.compile(r"^((?:nvidia|cuda)-[\w.-]+|triton)==", re.MULTILINE)
_ADDED = {  # to base.lock
    "ros2.lock": "What the extra ros2 adds to base.lock.",
    "batch.lock": "What the extra batch and batch_image.txt add to base.lock.",
}


def main() -> None:
    """Ends with 1 if --check finds that a lock is not what it would be now."""
    parser = argparse.ArgumentParser(description="Writes or checks the locks.")
    parser.add_argument("uv", help="the command uv")
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--check", action="store_true", help="write nothing, compare")
    choice.add_argument("--upgrade", action="store_true", help="newest versions, not the pinned")
    options = parser.parse_args()
    for name, text in _locked(options.uv, options.upgrade).items():
        path = ROOT / FOLDER / name
        if not options.check:
            path.write_text(text)
        elif not path.exists() or path.read_text() != text:
            sys.exit(f"{FOLDER / name} does not fit what it is made from: run `make lock`")


def resolve(uv: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Runs `uv pip compile` in the repository's root against PyPI, without pip's and uv's settings."""
    settings = ("PIP_", "UV_", "VIRTUAL_ENV")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(settings)}
    kept = {k: v for k, v in os.environ.items() if k in ("UV_CACHE_DIR",)}
    command = [uv, "pip", "compile", "--no-config", "--quiet"]
    command += [
        "--python",
        sys.executable,
        "--no-python-downloads",
    ]  # the version asked for is not run
    command += ["--default-index", "https://pypi.org/simple", *arguments]
    return subprocess.run(
        command, cwd=ROOT, env=environment | kept, text=True, capture_output=True, check=False
    )


def _locked(uv: str, upgrade: bool) -> dict[str, str]:
    """The text of each lock; one resolution with PyTorch gives the versions of both."""
    with tempfile.TemporaryDirectory() as folder:
        everything = Path(folder) / "everything.txt"
        without = Path(folder) / "without.txt"
        without.write_text("torch\n")
        pins = ROOT / FOLDER / "dev.lock"
        everything.write_text(pins.read_text() if pins.exists() else "")
        universal = ["--universal", "--python-version", "3.11", "pyproject.toml"]
        _compile(
            uv, *universal, "--all-extras", str(FOLDER / "torch.txt"), "--output-file",
            str(everything), *(["--upgrade"] if upgrade else []),
        )  # fmt: skip
        texts = {}
        for name, extra in LOCKS.items():
            if name in _ADDED:
                without.write_text("\n".join(["torch", *_names(texts["base.lock"])]))
            target = Path(folder) / name
            old = ROOT / FOLDER / name
            target.write_text(old.read_text() if old.exists() else "")  # keeps its hashes
            _compile(
                uv, *universal, *extra, "--generate-hashes", "--no-header", "--excludes",
                str(without), "--constraints", str(everything), "--output-file", str(target),
            )  # fmt: skip
            lines = target.read_text().splitlines(keepends=True)
            kept = [line for line in lines if not line.endswith(f"-c {everything}\n")]
            origin = (
                _FROM if name != "batch.lock" else "pyproject.toml, torch.txt and batch_image.txt"
            )
            texts[name] = _HEADER.format(origin, _ADDED.get(name, _ALL)) + "".join(kept)
        texts |= _locked_torch(uv, everything, _names(texts["base.lock"]))
    return texts


def _locked_torch(uv: str, constraints: Path, of_base: list[str]) -> dict[str, str]:
    """The text of the two locks of PyTorch; `of_base` names what base.lock has."""
    cuda = _compiled_torch(uv, "torch_cuda.lock", constraints, of_base)
    # PyPI's build with CUDA stands in for the one for the CPU, which needs the same but for CUDA
    not_cuda = [*of_base, *_OF_CUDA.findall(cuda)]
    cpu = _compiled_torch(uv, "torch_cpu.lock", constraints, not_cuda)
    (version,) = _TORCH_ENTRY.findall(cpu)
    texts = {
        # `===` leaves out builds such as 2.13.0+cpu, which would count as newer
        "torch_cuda.lock": re.sub(r"(?m)^torch==", "torch===", cuda),
        "torch_cpu.lock": _TORCH_ENTRY.sub(lambda _: _cpu_entry(version), cpu),
    }
    return {name: _HEADER.format("torch.txt", _BUILDS[name]) + text for name, text in texts.items()}


def _compiled_torch(uv: str, name: str, constraints: Path, without: list[str]) -> str:
    """PyTorch with CUDA and what it needs, but for the packages in `without`; keeps the pins of a lock."""
    target, excludes = constraints.with_name(name), constraints.with_name("excludes.txt")
    old = ROOT / FOLDER / name
    target.write_text(old.read_text().replace("+cpu", "") if old.exists() else "")
    excludes.write_text("\n".join(without))
    _compile(
        uv, "--universal", "--python-version", "3.11", str(_TORCH), "--generate-hashes",
        "--no-header", "--no-annotate", "--excludes", str(excludes), "--constraints",
        str(constraints), "--output-file", str(target),
    )  # fmt: skip
    return target.read_text()


def _cpu_entry(version: str) -> str:
    """The lines on torch in torch_cpu.lock: the present ones if they have this version."""
    path = ROOT / FOLDER / "torch_cpu.lock"
    begin = f"torch=={version}+cpu \\\n"
    if path.exists() and begin in path.read_text():
        after = path.read_text().partition(begin)[2]
        hashes = re.match(r"(?:    --hash=\S+(?: \\)?\n)+", after)
        return begin + hashes[0] if hashes else begin
    page = f"{CPU_INDEX}/torch/"
    try:
        with urllib.request.urlopen(page, timeout=30) as answer:
            wheels = cpu_wheels(answer.read().decode(), version)
    except (OSError, ValueError) as error:
        sys.exit(f"torch_cpu.lock: the hashes of torch {version}+cpu are read from {page}: {error}")
    return begin + " \\\n".join(f"    --hash=sha256:{digest}" for digest in wheels) + "\n"


def _names(lock: str) -> list[str]:
    return re.findall(r"^([\w.-]+)==", lock, re.MULTILINE)


def _compile(uv: str, *arguments: str) -> None:
    done = resolve(uv, *arguments)
    if done.returncode:
        sys.exit(f"uv pip compile {' '.join(arguments)}:\n{done.stderr}")


if __name__ == "__main__":
    main()
