"""Rows of injected faults: none may show its problem."""

import shutil
from functools import partial

from hsslam_bench.checks.check import Check, Measured
from hsslam_bench.faults.catalogue import FAULTS
from hsslam_bench.faults.experiment import Experiment, can_mount
from hsslam_bench.faults.fault import CouldNotTellError, Fault
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.session import NotMeasured, Session

_BOUND = "not shown"


def fault_checks() -> list[Check]:
    """One check for each fault of the catalogue; the figure is 1 if the problem is shown, else 0."""
    return [
        Check(
            f"faults:{fault.name}",
            f"{fault.happens}: {fault.must}",
            _BOUND,
            partial(_measure, fault),
            by_name_only=True,
        )
        for fault in FAULTS
    ]


def _measure(fault: Fault, session: Session) -> Measured:
    if fault.needs_root and not can_mount():
        raise NotMeasured("needs root and mount namespaces")
    folder = session.folder / f"fault-{fault.name}"
    session.warm_up()
    try:
        with Experiment(folder) as experiment:
            finding = fault.find(experiment)
    except CouldNotTellError as error:
        raise RunFailedError(f"could not decide: {error}") from None
    shutil.rmtree(folder, ignore_errors=True)  # after an error the folder stays
    word = "shown" if finding.is_shown else _BOUND
    return Measured(
        f"{word}: {finding.seen}", not finding.is_shown, {}, float(finding.is_shown), "lower"
    )
