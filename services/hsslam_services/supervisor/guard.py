"""Keeps the supervisor's loop alive: if a part of a turn raises, the other parts still run."""

import time
from collections.abc import Callable

_PATIENCE_S = 10.0  # for a needed part that raises in every turn, as without descriptors
_REPORT_FACTOR = 100  # the next report comes at this multiple of the failures


class Guard:
    """Runs the parts of a turn, reports their exceptions, and finds a needed part that does not recover.

    `report(text)` gets the first failure of each part, then ever fewer. `failures`: counts by part.
    """

    def __init__(self, report: Callable[[str], None], patience_s: float = _PATIENCE_S) -> None:
        self.failures: dict[str, int] = {}
        self._report = report
        self._patience_s = patience_s
        self._failing_since_s: dict[str, float] = {}  # needed parts
        self._report_at: dict[str, int] = {}  # failures, by part

    def run(self, part: str, action: Callable[[], object], *, is_needed: bool = False) -> None:
        """Run `action`; count and report an exception."""
        try:
            action()
        except Exception as error:  # of any kind: the processes of the run need this loop
            if is_needed:
                self._failing_since_s.setdefault(part, time.monotonic())
            self._count(part, error)
        else:
            self._failing_since_s.pop(part, None)

    def hopeless_part(self) -> str:
        """A needed part that has raised in every turn for `patience_s`; "" if there is none."""
        now_s = time.monotonic()
        for part, since_s in self._failing_since_s.items():
            if now_s - since_s > self._patience_s:
                return part
        return ""

    def _count(self, part: str, error: Exception) -> None:
        count = self.failures[part] = self.failures.get(part, 0) + 1
        if count < self._report_at.get(part, 1):
            return
        self._report_at[part] = _REPORT_FACTOR * count
        text = " ".join(str(error).split()) or type(error).__name__
        self._report(f"supervisor: {part}: {text} ({count} x)")
