"""Validity of a certificate; warnings before it begins, and from 14 days before it ends."""

import datetime
from dataclasses import dataclass
from pathlib import Path

_WARNED_BEFORE = datetime.timedelta(days=14)
_REPEATED_AFTER = datetime.timedelta(days=1)


@dataclass(frozen=True)
class CertificateValidity:
    """The time in which the certificate of a folder and its CA are both valid."""

    folder: Path
    begins: datetime.datetime  # aware
    ends: datetime.datetime  # aware

    def days_left(self, now: datetime.datetime) -> float:
        """Days from `now` to the end; negative after it."""
        return (self.ends - now) / datetime.timedelta(days=1)

    def warning(self, now: datetime.datetime) -> str:
        """The warning for the user; empty if the certificate is valid for more than 14 days."""
        of = f"--security {self.folder}: the certificate"
        if now < self.begins:
            return (
                f"{of} is not valid before {self.begins:%Y-%m-%d %H:%M} UTC, but it is "
                f"{now:%Y-%m-%d %H:%M} UTC: expected a correct clock on this machine"
            )
        if self.ends - now > _WARNED_BEFORE:
            return ""
        days = self.days_left(now)
        when = "has ended" if days <= 0 else "ends"
        left = f", in {days:.0f} days" if days >= 1 else f", in {24 * days:.1f} hours"
        on = f"on {self.ends:%Y-%m-%d %H:%M} UTC{left if days > 0 else ''}"
        return f"{of} {when} {on}: hsslam-certs DIR --ca FOLDER makes new ones"


class CertificateWarnings:
    """Repeats the warning of a certificate once a day, and when it ends."""

    def __init__(self, validity: CertificateValidity | None) -> None:
        self._validity = validity
        self._due: datetime.datetime | None = None

    def take(self, now: datetime.datetime) -> str:
        """The warning, if it is due; else empty."""
        if self._validity is None or (self._due is not None and now < self._due):
            return ""
        text = self._validity.warning(now)
        if text:
            self._due = now + _REPEATED_AFTER
            if now < self._validity.ends < self._due:
                self._due = self._validity.ends
        return text

    def days_left(self, now: datetime.datetime) -> float | None:
        """Days until the certificate ends; None without one."""
        return self._validity.days_left(now) if self._validity else None
