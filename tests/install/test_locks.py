"""The locks: what they hold, for every Python and machine; that they resolve is checked by `make resolve`."""

import importlib.metadata
import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from requirements.install import torch_requirement
from requirements.torch_index import MACHINES, PYTHONS, cpu_wheels

ROOT = Path(__file__).parents[2]
_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
_WANTED = {
    "base.lock": _PROJECT["dependencies"],
    "dev.lock": _PROJECT["dependencies"] + _PROJECT["optional-dependencies"]["dev"],
    "ros2.lock": _PROJECT["optional-dependencies"]["ros2"],
}
_OF_TORCH = ("torch_cpu.lock", "torch_cuda.lock")
_MACHINES = [
    {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_machine": machine,
        "sys_platform": "linux",
        "platform_system": "Linux",
    }
    for python in ("3.11", "3.12", "3.13", "3.14")
    for machine in ("x86_64", "aarch64")
]


def _entries(lock: str) -> list[str]:
    """A lock's requirements, each with its hashes on one line."""
    text = (ROOT / "requirements" / lock).read_text().replace("\\\n", " ")
    return [line for line in text.splitlines() if line and not line.lstrip().startswith("#")]


def _pins(lock: str) -> list[Requirement]:
    return [Requirement(entry.split("--hash")[0].strip()) for entry in _entries(lock)]


@pytest.mark.parametrize("lock", (*_WANTED, "batch.lock", *_OF_TORCH))
def test_every_package_of_a_lock_has_one_version_and_hashes(lock):
    for entry in _entries(lock):
        assert re.match(r"[\w.-]+===?\S+ ", entry), entry
        assert re.search(r"--hash=sha256:[0-9a-f]{64}\b", entry), entry


@pytest.mark.parametrize("lock", _WANTED)
def test_a_lock_leaves_pytorch_to_the_installer_and_names_no_index(lock):
    names = {canonicalize_name(pin.name) for pin in _pins(lock)}
    of_ray = {"filelock", "fsspec"} if lock == "dev.lock" else set()
    assert not names & ({"torch", "sympy", "mpmath", "filelock", "fsspec"} - of_ray)
    assert not [name for name in names if name.startswith(("nvidia-", "cuda-"))]
    assert "://" not in "".join(_entries(lock))


def test_the_base_has_nothing_of_ray():
    names = {canonicalize_name(pin.name) for pin in _pins("base.lock")}
    assert not names & {"ray", "fsspec", "s3fs"}


@pytest.mark.parametrize("lock", _WANTED)
def test_a_lock_has_what_the_project_asks_for_on_every_machine(lock):
    for machine in _MACHINES:
        pinned = {
            canonicalize_name(pin.name): str(next(iter(pin.specifier)).version)
            for pin in _pins(lock)
            if pin.marker is None or pin.marker.evaluate(machine)
        }
        for wanted in map(Requirement, _WANTED[lock]):
            if wanted.name == "torch" or (wanted.marker and not wanted.marker.evaluate(machine)):
                continue
            assert wanted.specifier.contains(pinned[canonicalize_name(wanted.name)]), machine


def test_tests_run_with_the_versions_that_users_get():
    base, ros2, dev = (
        {(pin.name, str(pin.specifier)) for pin in _pins(lock)}
        for lock in ("base.lock", "ros2.lock", "dev.lock")
    )
    assert base | ros2 <= dev and not {name for name, _ in base} & {name for name, _ in ros2}


@pytest.mark.parametrize("lock", _OF_TORCH)
def test_a_lock_of_pytorch_has_all_that_its_build_needs_and_the_base_lacks(lock):
    pins = _pins(lock)
    versions = {canonicalize_name(pin.name): str(pin.specifier).lstrip("=") for pin in pins}
    release = torch_requirement().partition("==")[2]
    assert versions["torch"] == (f"{release}+cpu" if lock == "torch_cpu.lock" else release)
    base = {
        canonicalize_name(pin.name): str(pin.specifier).lstrip("=") for pin in _pins("base.lock")
    }
    assert not set(versions) & set(base)
    of_cuda = {name for name in versions if name.startswith(("nvidia-", "cuda-", "triton"))}
    assert bool(of_cuda) == (lock == "torch_cuda.lock")
    tested = {canonicalize_name(pin.name): str(pin.specifier) for pin in _pins("dev.lock")}
    for wanted in map(Requirement, importlib.metadata.requires("torch") or []):
        if wanted.marker is None:  # none of an extra
            name = canonicalize_name(wanted.name)
            version = (versions | base)[name]
            assert wanted.specifier.contains(version)
            assert tested.get(name, f"=={version}") == f"=={version}"


def test_pytorch_for_the_cpu_has_a_wheel_for_each_python_and_machine():
    (entry,) = [entry for entry in _entries("torch_cpu.lock") if entry.startswith("torch==")]
    assert entry.count("--hash=") == len(PYTHONS) * len(MACHINES)


def test_hashes_of_the_wheels_for_the_cpu_are_read_from_pytorch_s_index():
    names = [
        f"torch-9.0.1%2Bcpu-cp{python}-cp{python}{kind}-manylinux_2_28_{machine}.whl"
        for python in PYTHONS
        for kind in ("", "t")  # without the global lock: not installed on
        for machine in (*MACHINES, "s390x")
    ]
    links = [
        f'<a href="https://download-r2.pytorch.org/whl/cpu/{name}#sha256={k:064x}" '
        f'data-core-metadata="sha256={k + 100:064x}">{name}</a><br/>'
        for k, name in enumerate(names)
    ]
    found = cpu_wheels("\n".join(links), "9.0.1")
    assert [int(digest, 16) for digest in found] == [0, 1, 6, 7, 12, 13, 18, 19]
    with pytest.raises(
        ValueError, match=r"it lacks torch-9.0.1\+cpu-cp311-cp311-manylinux_2_28_aarch64"
    ):
        cpu_wheels("\n".join(links[:1] + links[2:]), "9.0.1")
