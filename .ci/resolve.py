"""Checks that everybody can install: the project and its locks resolve on plain PyPI.

python .ci/resolve.py UV

For Python 3.11 to 3.14, x86-64 and aarch64, with `dev`, with `ros2` and with `batch`, which all hold what
the base install needs: with the locks, and PyTorch with CUDA, as `make run`, `make test` and the images
install; for the oldest and the newest Python also without them, as `pip install .` does. Wheels alone:
nothing may need a compiler. The settings of pip and uv are ignored. Ends with 1 and every combination that
fails.
"""

import itertools
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "requirements"))

from lock import resolve  # noqa: E402

_PYTHONS = ("3.11", "3.12", "3.13", "3.14")
_MACHINES = ("x86_64", "aarch64")
_GLIBC = {"dev": "2_35", "ros2": "2_28", "batch": "2_28"}  # the wheels of Open3D want 2.35


def main(uv: str) -> None:
    """Prints one line a combination that fails, with the reason, or one line if none does."""
    check = [sys.executable, str(ROOT / "requirements" / "lock.py"), uv, "--check"]
    stale = subprocess.run(check, capture_output=True, text=True, check=False)
    ends = (_PYTHONS[0], _PYTHONS[-1])
    cases = [
        *itertools.product(_PYTHONS, _MACHINES, _GLIBC, ["locked"]),
        *itertools.product(ends, _MACHINES, _GLIBC, ["free"]),
    ]
    with ThreadPoolExecutor(4) as pool:
        troubles = list(pool.map(lambda case: _trouble(uv, *case), cases))
    failed = [(case, trouble) for case, trouble in zip(cases, troubles, strict=True) if trouble]
    for (python, machine, kind, way), trouble in failed:
        print(f"Python {python}, {machine}, {kind}, {way}:\n{trouble}")
    if stale.returncode:
        print(stale.stderr.strip())
    if failed or stale.returncode:
        sys.exit(f"resolve: {len(failed)} of {len(cases)} combinations fail")
    print(f"resolve: good: {len(cases)} combinations, and the locks fit pyproject.toml")


def _trouble(uv: str, python: str, machine: str, kind: str, way: str) -> str | None:
    """What uv says if a combination does not resolve."""
    inputs = ["pyproject.toml", "--extra", kind]
    if way == "locked":
        locks = (kind,) if kind == "dev" else ("base", kind)
        inputs += ["requirements/torch_cuda.lock", *(f"requirements/{lock}.lock" for lock in locks)]
    platform = f"{machine}-manylinux_{_GLIBC[kind]}"
    done = resolve(
        uv, *inputs, "--python-version", python, "--python-platform", platform,
        "--only-binary", ":all:", "--no-header",
    )  # fmt: skip
    return done.stderr.strip() or f"exit code {done.returncode}" if done.returncode else None


if __name__ == "__main__":
    main(sys.argv[1])
