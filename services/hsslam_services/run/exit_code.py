"""Table of the exit codes of `hsslam-serve`, for the service, its help and the docs."""

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType


class ExitCode(IntEnum):
    """How a run ended; service managers restart on 3 and 4."""

    SAVED = 0
    CUT_SHORT = 1
    BAD_INPUT = 2
    FAILED = 3
    NOT_SAVED = 4


MEANINGS: Mapping[ExitCode, str] = MappingProxyType(
    {
        ExitCode.SAVED: "the run is complete, everything is saved",
        ExitCode.CUT_SHORT: "a second signal ended the run at once",
        ExitCode.BAD_INPUT: "the input is bad, found before the first map",
        ExitCode.FAILED: "a failure ended the run, everything is saved",
        ExitCode.NOT_SAVED: "a result is not saved, or the supervisor crashed; the last lines say what to do",
    }
)


def exit_code_help() -> str:
    """The table as lines of `--help`."""
    lines = [f"  {code.value}  {text}" for code, text in MEANINGS.items()]
    return "\n".join(["Exit codes:", *lines])


def ending(*, is_cut_short: bool, is_refused: bool, has_failed: bool, is_saved: bool) -> ExitCode:
    """The code of a run that has begun. Order: bad input, unsaved results, a second signal, a failure."""
    if is_refused:
        return ExitCode.BAD_INPUT
    if not is_saved:
        return ExitCode.NOT_SAVED
    if is_cut_short:
        return ExitCode.CUT_SHORT
    return ExitCode.FAILED if has_failed else ExitCode.SAVED
