"""A check, and its finding."""

import math
from dataclasses import dataclass
from typing import Literal

Severity = Literal["ok", "note", "fault"]


@dataclass(frozen=True)
class Finding:
    """The outcome of one check: what was measured, what was expected, and what to do about it.

    *fault*: a run on this source fails or has a wrong scale. *note*: worth knowing, or it could not be
    measured.

    Raises:
        ValueError: a measurement is not finite, or a fault lacks what was expected or what to do.
    """

    name: str
    severity: Severity
    value: float | None  # None: could not be measured
    unit: str
    seen: str  # in plain words, figures with units
    expected: str
    advice: str = ""  # empty only if there is nothing to do

    def __post_init__(self) -> None:
        if self.severity not in ("ok", "note", "fault"):
            raise ValueError(f"severity {self.severity!r}: expected ok, note or fault")
        if self.value is not None and not math.isfinite(self.value):
            raise ValueError(f"{self.name}: value {self.value}: expected a finite number or None")
        if self.severity == "fault" and not (self.expected and self.advice):
            raise ValueError(f"{self.name}: a fault says what was expected and what to do")


@dataclass(frozen=True)
class Check:
    """What is measured, in which unit, and what is expected of it; makes the findings."""

    name: str
    unit: str
    expected: str

    def ok(self, value: float | None, seen: str) -> Finding:
        """As expected."""
        return Finding(self.name, "ok", value, self.unit, seen, self.expected)

    def note(self, value: float | None, seen: str, advice: str = "") -> Finding:
        """Worth knowing, or it could not be measured (None)."""
        return Finding(self.name, "note", value, self.unit, seen, self.expected, advice)

    def fault(self, value: float, seen: str, advice: str) -> Finding:
        """A run on this source goes wrong."""
        return Finding(self.name, "fault", value, self.unit, seen, self.expected, advice)
