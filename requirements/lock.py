"""Writes base.lock, dev.lock, ros2.lock and batch.lock, or checks that they fit
pyproject.toml, torch.txt and batch_image.txt.

python requirements/lock.py UV [--check | --upgrade]

A lock holds everything but PyTorch and what only PyTorch brings, with hashes, for every platform and
Python 3.11 or newer. ros2.lock holds what the extra ros2 adds to base.lock; batch.lock what the extra batch
and batch_image.txt add. Pins stay as they are until --upgrade. The settings of pip and uv are ignored: the
packages are those of PyPI, as everybody gets them.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

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
    return texts


def _names(lock: str) -> list[str]:
    return re.findall(r"^([\w.-]+)==", lock, re.MULTILINE)


def _compile(uv: str, *arguments: str) -> None:
    done = resolve(uv, *arguments)
    if done.returncode:
        sys.exit(f"uv pip compile {' '.join(arguments)}:\n{done.stderr}")


if __name__ == "__main__":
    main()
