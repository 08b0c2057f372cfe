"""Settings and fixtures of all tests."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.folder_of_workers import share
from tests.order_of_tests import in_order, without_group
from tests.power_cut import Disk
from tests.sequence_folders import replica_folder, tum_folder  # noqa: F401

os.environ["HSSLAM_TUM_URL"] = "http://127.0.0.1:9"  # no test fetches from elsewhere

# Shared machines stall, and kernels compile at their first call: no time limit on one example.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist reads the groups
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if getattr(config.option, "loadgroup", False):
        items[:] = in_order(items)


@pytest.hookimpl(tryfirst=True)  # before pytest notes which tests `--last-failed` takes
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if hasattr(report, "node"):  # of a worker of pytest-xdist
        report.nodeid = without_group(report.nodeid)


@pytest.fixture(scope="session", autouse=True)
def _folder_of_workers(tmp_path_factory: pytest.TempPathFactory) -> None:
    share(tmp_path_factory.getbasetemp().parent)


@pytest.fixture(scope="session")
def test_data() -> Path:
    """The folder of real sequences; skips where it is absent."""
    default = Path(__file__).parents[1] / "../shared/data"
    path = Path(os.environ.get("HSSLAM_TEST_DATA", default))
    if not path.is_dir():
        pytest.skip(f"no sequences at {path} (HSSLAM_TEST_DATA)")
    return path.resolve()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    """A disk whose power can be cut."""
    disk = Disk(tmp_path / "power")
    try:
        yield disk
    finally:
        disk.close()
