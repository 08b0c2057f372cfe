"""Which failures are worth another attempt."""

import pytest

from hsslam_batch.attempt.outcome import Outcome, may_try_again


@pytest.mark.parametrize(
    ("kind", "attempts"),
    [("done", 1), ("bad input", 1), ("memory", 1), ("timeout", 2), ("crash", 4), ("lost", 4)],
)
def test_attempts_by_kind(kind, attempts: int):
    tried = 1
    while may_try_again(Outcome("id", "name", "configuration", tried, kind), retries=3):
        tried += 1
    assert tried == attempts
    assert not may_try_again(Outcome("id", "name", "configuration", 1, kind), retries=0)
