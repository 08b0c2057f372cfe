"""The time stamp or number in the name of an image."""

import re
from datetime import UTC, datetime
from decimal import Decimal

from hsslam_node.errors import UserError
from hsslam_node.geometry.trajectory import parse_stamp_ns

# 2024-01-31_12-30-55.250 and the like; a time without a fraction is that of many images
_DATE_AND_TIME = re.compile(
    r"(?<!\d)(\d{4})[-_.]?(\d\d)[-_.]?(\d\d)[T_ -](\d\d)[-_:.]?(\d\d)[-_:.]?(\d\d)[._-](\d{1,9})(?!\d)"
)
_SECONDS_DIGITS = 10  # before the point, of a time since 1970
_NS_BY_DIGITS = {13: 1_000_000, 16: 1000, 19: 1}  # since 1970: ms, us, ns


def name_stamp_ns(stem: str) -> int | None:
    """Time in a file name, ns; None if there is none.

    `1305031102.175304` (s), `rgb_1700000000_123456789` (s and ns, or 6 digits of us),
    `2024-01-31_12-30-55.250` (taken as UTC), or numbers of 13, 16 or 19 digits before the point, if any,
    which do not begin with 0: ms, us or ns since 1970. Of several numbers the only one that is a time since
    1970 counts, as in `1700000000000000000_640x480`, else the last. A number with a point right behind a
    letter is a time only if it is one since 1970: `room1.0001` is image 1 of room1.
    """
    if both := re.search(r"(?<!\d)(\d{10})[_-](\d{9}|\d{6})(?!\d)", stem):
        return int(both[1]) * 1_000_000_000 + int(both[2].ljust(9, "0"))
    if date := _DATE_AND_TIME.search(stem):
        *whole, fraction = date.groups()
        try:
            moment = datetime(*map(int, whole), tzinfo=UTC)  # type: ignore[arg-type, misc]
        except ValueError:  # as of a 13th month
            return None
        return int(moment.timestamp()) * 1_000_000_000 + int(fraction.ljust(9, "0"))
    numbers = list(re.finditer(r"\d+\.\d+|\d+", stem))
    if not numbers:
        return None
    since_1970 = [found for found in numbers if _is_since_1970(found.group())]
    found = since_1970[0] if len(since_1970) == 1 else numbers[-1]
    number = found.group()
    stamp_ns = long_stamp_ns(number)
    if stamp_ns is not None or "." not in number:
        return stamp_ns
    is_in_word = stem[: found.start()][-1:].isalpha()
    if is_in_word and number.index(".") < _SECONDS_DIGITS:
        return None
    try:
        return parse_stamp_ns(number)
    except ValueError:  # too large for nanoseconds
        return None


def unpadded_stamps_ns(stems: list[str]) -> list[int] | None:
    """Times in file names that have seconds and nanoseconds without leading zeros, ns.

    `1700000000_5000000` is 5 ms after the second. None: a name has no such time, or two have the same, or
    all second numbers have 9 digits (they may have leading zeros), or none has (they may be microseconds).
    """
    found = [re.search(r"(?<!\d)(\d{10})[_-](0|[1-9]\d{0,8})(?!\d)", stem) for stem in stems]
    times = [both.groups() for both in found if both]
    if len(times) < len(stems) or len({len(ns) == 9 for _, ns in times}) < 2:
        return None
    stamps_ns = [int(s) * 1_000_000_000 + int(ns) for s, ns in times]
    return stamps_ns if len(set(stamps_ns)) == len(stems) else None


def _is_since_1970(number: str) -> bool:
    whole, _, fraction = number.partition(".")
    is_seconds = len(whole) == _SECONDS_DIGITS and whole[0] != "0" and bool(fraction)
    return is_seconds or long_stamp_ns(number) is not None


def long_stamp_ns(number: str) -> int | None:
    """A number as a time since 1970, with the unit by its digits before the point; None: no such length."""
    digits, _, fraction = number.partition(".")
    unit_ns = None if digits[0] == "0" else _NS_BY_DIGITS.get(len(digits))
    if unit_ns is None:
        return None
    return int(digits) * unit_ns + int(Decimal(f"0.{fraction or 0}") * unit_ns)


def numbered_stamp_ns(number: int, rate_hz: float) -> int:
    """Stamp of the frame with this number in its file name, if frames come at `rate_hz`, ns.

    Raises:
        UserError: the stamp does not fit int64, as if the number is a time.
    """
    stamp_ns = round(number * 1e9 / rate_hz)
    if stamp_ns >= 1 << 63:
        most = int((1 << 63) * rate_hz / 1e9)
        raise UserError(
            f"frame number {number} in a file name: expected at most {most}; record:FOLDER reads times "
            "in names"
        )
    return stamp_ns


def name_number(stem: str) -> int | None:
    """The last whole number in a file name."""
    numbers = re.findall(r"\d+", stem)
    return int(numbers[-1]) if numbers else None
