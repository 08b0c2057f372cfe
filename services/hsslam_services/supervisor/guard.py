"""What keeps the supervisor's loop alive: a part of a turn that raises costs no other part and no run."""

import time
from collections.abc import Callable

_PATIENCE_S = 10.0  # for a needed part that raises in every turn, as without descriptors
_TOLD_AGAIN = 100  # times as many failures as when it was reported last


class Guard:
    """Runs the parts of a turn, reports what they raise, and says when a needed part does not recover.

    `report(text)` takes the lines: the first of each part, then ever fewer. `failures` counts by part.
    """

    def __init__(self, report: Callable[[str], None], patience_s: float = _PATIENCE_S) -> None:
        self.failures: dict[str, int] = {}
        self._report = report
        self._patience_s = patience_s
        self._failing_since_s: dict[str, float] = {}  # needed parts
        self._tell_at: dict[str, int] = {}

    def run(self, part: str, action: Callable[[], object], *, is_needed: bool = False) -> None:
        """Do it; an exception is counted and reported here."""
        try:
            action()
        except Exception as error:  # whatever it is: the processes of the run live on this loop
            if is_needed:
                self._failing_since_s.setdefault(part, time.monotonic())
            self._count(part, error)
        else:
            self._failing_since_s.pop(part, None)

    def hopeless_part(self) -> str:
        """A needed part that has raised in every turn for long; "" if there is none."""
        now_s = time.monotonic()
        for part, since_s in self._failing_since_s.items():
            if now_s - since_s > self._patience_s:
                return part
        return ""

    def _count(self, part: str, error: Exception) -> None:
        count = self.failures[part] = self.failures.get(part, 0) + 1
        if count < self._tell_at.get(part, 1):
            return
        self._tell_at[part] = _TOLD_AGAIN * count
        text = " ".join(str(error).split()) or type(error).__name__
        self._report(f"supervisor: {part}: {text} ({count} x)")
