"""The locks: what they hold, for every Python and machine; that they resolve is checked by `make resolve`."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
_PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
_WANTED = {
    "base.lock": _PROJECT["dependencies"],
    "dev.lock": _PROJECT["dependencies"] + _PROJECT["optional-dependencies"]["dev"],
    "ros2.lock": _PROJECT["optional-dependencies"]["ros2"],
}
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


@pytest.mark.parametrize("lock", _WANTED)
def test_every_package_of_a_lock_has_one_version_and_hashes(lock):
    for entry in _entries(lock):
        assert re.match(r"[\w.-]+==\S+ ", entry), entry
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
