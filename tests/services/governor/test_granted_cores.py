import os
from pathlib import Path

import pytest

from hsslam_services.governor.granted_cores import granted_cores
from tests.services.governor.under_quota import printed_under_quota

_OWN_CORES = len(os.sched_getaffinity(0))


def _group(tmp_path: Path, own: str, files: dict[str, str]) -> float:
    (tmp_path / "own").write_text(own)
    for name, text in files.items():
        file = tmp_path / "groups" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return granted_cores(tmp_path / "own", tmp_path / "groups")


@pytest.mark.parametrize(
    ("own", "files", "cores"),
    [
        ("0::/a/b\n", {"a/b/cpu.max": "50000 100000\n"}, 0.5),
        ("0::/a/b\n", {"a/cpu.max": "30000 100000\n", "a/b/cpu.max": "50000 100000\n"}, 0.3),
        ("0::/\n", {"cpu.max": "25000 50000\n"}, 0.5),  # a container sees its own group as the root
        (
            "3:cpu,cpuacct:/x\n1:memory:/y\n",
            {"cpu,cpuacct/x/cpu.cfs_quota_us": "20000\n", "cpu,cpuacct/x/cpu.cfs_period_us": "100000\n"},
            0.2,
        ),
        (
            "3:cpu:/not/there\n",  # nor here: the mount is the group of the container
            {"cpu/cpu.cfs_quota_us": "70000\n", "cpu/cpu.cfs_period_us": "100000\n"},
            0.7,
        ),
    ],
)  # fmt: skip
def test_the_smallest_quota_counts(tmp_path: Path, own: str, files: dict[str, str], cores: float):
    assert _group(tmp_path, own, files) == pytest.approx(cores)


@pytest.mark.parametrize(
    ("own", "files"),
    [
        ("0::/a\n", {"a/cpu.max": "max 100000\n"}),
        ("1:cpu:/\n", {"cpu/cpu.cfs_quota_us": "-1\n", "cpu/cpu.cfs_period_us": "100000\n"}),
        ("1:memory:/\n", {"memory/cpu.max": "1000 100000\n"}),
        ("0::/a\n", {"a/cpu.max": "9900000 100000\n"}),
        ("0::/a\n", {"a/cpu.max": "no number\n"}),
        ("", {}),
    ],
)
def test_without_a_smaller_quota_the_affinity_counts(
    tmp_path: Path, own: str, files: dict[str, str]
):
    assert _group(tmp_path, own, files) == _OWN_CORES


def test_a_machine_without_control_groups(tmp_path: Path):
    assert granted_cores(tmp_path / "none", tmp_path / "none") == _OWN_CORES


def test_a_quota_of_the_kernel_is_found():
    code = (
        "from hsslam_services.governor.granted_cores import granted_cores\nprint(granted_cores())"
    )
    assert float(printed_under_quota(code, 0.4)) == pytest.approx(0.4)
