"""One row of the benchmark: what it measures, its bound, and its result."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from hsslam_bench.runs.sequences import Skipped
from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.session import NotMeasured, Session
from hsslam_node.errors import UserError, did_you_mean

Verdict = Literal["ok", "NOT MET", "measured", "skipped", "not measured"]
NO_FIGURE: tuple[Verdict, ...] = ("skipped", "not measured")
Better = Literal["lower", "higher", ""]  # "": neither


@dataclass(frozen=True)
class Measured:
    """A result as text and as raw values, and whether it meets the bound (None: there is no bound)."""

    text: str
    ok: bool | None = None
    values: Mapping[str, Any] = field(default_factory=dict)
    figure: float | None = None  # the number to compare with other results
    better: Better = ""


@dataclass(frozen=True)
class Check:
    """A row of the table."""

    name: str  # for --only; parts before a colon select whole groups
    what: str
    bound: str  # "": no bound
    measure: Callable[[Session], Measured]
    by_name_only: bool = False  # takes long, or the documents do not show it
    is_lockstep: bool = False  # its results do not depend on the load of the machine
    version: int = 1  # raised if the measurement changes but `what` and `bound` stay


@dataclass(frozen=True)
class Row:
    """A check with its result, as stored in the JSON file."""

    name: str
    what: str
    bound: str
    measured: str
    verdict: Verdict
    values: Mapping[str, Any] = field(default_factory=dict)
    figure: float | None = None
    better: Better = ""
    version: int = 1  # of the check that was measured; stored rows without it have 1

    @property
    def definition(self) -> tuple[str, str, int]:
        """Equal for rows that measure the same."""
        return self.what, self.bound, self.version


def perform(check: Check, session: Session) -> Row:
    """Measure one row.

    A row whose data is not on disk is skipped. A run that fails misses the bound. A row that this machine
    cannot measure gets the reason as its text.
    """
    try:
        result = check.measure(session)
    except Skipped as skipped:
        return _row(check, Measured(str(skipped)), "skipped")
    except NotMeasured as reason:
        return _row(check, Measured(str(reason)), "not measured")
    except RunFailedError as failure:
        return _row(check, Measured(str(failure)), "NOT MET")
    return _row(
        check, result, "measured" if result.ok is None else "ok" if result.ok else "NOT MET"
    )


def unmeasured(check: Check) -> Row:
    """The row of a check that was not measured."""
    return _row(check, Measured(""), "not measured")


def _row(check: Check, result: Measured, verdict: Verdict) -> Row:
    return Row(
        name=check.name,
        what=check.what,
        bound=check.bound,
        measured=result.text,
        verdict=verdict,
        values=dict(result.values),
        figure=result.figure,
        better=result.better,
        version=check.version,
    )


def select(checks: Iterable[Check], names: Sequence[str]) -> list[Check]:
    """The checks with these names or in these groups ("ate" includes "ate:house"), in the table's order.

    Without names: all checks that are not `by_name_only`.

    Raises:
        UserError: no check has the name; the message suggests the nearest name.
    """
    checks = list(checks)
    known = {
        ":".join(check.name.split(":")[:depth])
        for check in checks
        for depth in range(1, check.name.count(":") + 2)
    }
    for name in names:
        if name not in known:
            hint = did_you_mean(name, sorted(known))
            raise UserError(f"--only {name}: no such row{hint or '; --list has the names'}")
    if not names:
        return [check for check in checks if not check.by_name_only]
    return [c for c in checks if any(f"{c.name}:".startswith(f"{name}:") for name in names)]
