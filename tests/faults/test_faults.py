"""Faults that are made to happen to the real service, as in `hsslam-bench --only faults`.

Those that are long, or not mended yet, have the mark `long`: `pytest -m long tests/faults`.
"""

from pathlib import Path

import pytest

from hsslam_bench.faults.catalogue import FAULTS
from hsslam_bench.faults.experiment import Experiment, can_mount
from hsslam_bench.faults.fault import Fault

pytestmark = pytest.mark.e2e
_CI_SECONDS = 60.0


def _parameter(fault: Fault):
    marks = [] if fault.in_ci else [pytest.mark.long]
    return pytest.param(fault, id=fault.name, marks=marks)


@pytest.mark.parametrize("fault", [_parameter(fault) for fault in FAULTS])
def test_the_service_stands(fault: Fault, tmp_path: Path):
    if fault.needs_root and not can_mount():
        pytest.skip("needs root and mount namespaces")
    with Experiment(tmp_path / "place") as experiment:
        finding = fault.find(experiment)
    assert not finding.is_shown, finding.seen


def test_names_differ_and_ci_is_short():
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names)
    assert sum(fault.seconds for fault in FAULTS if fault.in_ci) <= _CI_SECONDS
