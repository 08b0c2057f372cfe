"""When a certificate ends, and the warning 14 days before."""

import datetime
from dataclasses import dataclass
from pathlib import Path

_WARNED_BEFORE = datetime.timedelta(days=14)
_REPEATED_AFTER = datetime.timedelta(days=1)


@dataclass(frozen=True)
class CertificateEnd:
    """The end of the certificate of a folder, or of its CA if that ends first."""

    folder: Path
    ends: datetime.datetime  # aware

    def days_left(self, now: datetime.datetime) -> float:
        """Days from `now`; negative if it has ended."""
        return (self.ends - now) / datetime.timedelta(days=1)

    def warning(self, now: datetime.datetime) -> str:
        """What the user must do; empty if the end is more than 14 days away."""
        if self.ends - now > _WARNED_BEFORE:
            return ""
        return (
            f"--security {self.folder}: the certificate ends on {self.ends.date()}, in "
            f"{max(self.days_left(now), 0):.0f} days: hsslam-certs makes new ones"
        )


class CertificateWarnings:
    """Takes out the warning of a certificate once a day."""

    def __init__(self, end: CertificateEnd | None) -> None:
        self._end = end
        self._due: datetime.datetime | None = None

    def take(self, now: datetime.datetime) -> str:
        """The warning if it is due; else empty."""
        if self._end is None or (self._due is not None and now < self._due):
            return ""
        text = self._end.warning(now)
        if text:
            self._due = now + _REPEATED_AFTER
        return text

    def days_left(self, now: datetime.datetime) -> float | None:
        """Days until the certificate ends; None without one."""
        return self._end.days_left(now) if self._end else None
