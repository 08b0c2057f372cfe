"""The exit code of a run with which more than one thing has gone wrong."""

import pytest

from hsslam_services.run.exit_code import ExitCode, ending


@pytest.mark.parametrize(
    ("is_refused", "is_saved", "code"),
    [
        (False, True, ExitCode.CUT_SHORT),
        (False, False, ExitCode.NOT_SAVED),  # else nobody looks for what is kept in memory
        (True, False, ExitCode.BAD_INPUT),
    ],
)
def test_a_second_signal_hides_nothing_that_is_worse(is_refused, is_saved, code):
    told = ending(is_cut_short=True, is_refused=is_refused, has_failed=True, is_saved=is_saved)
    assert told == code
