"""Restarts: back-off, crash loop, forgiveness."""

from hypothesis import given
from hypothesis import strategies as st

from hsslam_services.launch.restart_policy import RestartPolicy


def test_delays_double_to_the_longest_and_the_sixth_failure_gives_up():
    policy = RestartPolicy(0.5, 3.0)
    assert [policy.failed(t) for t in range(6)] == [0.5, 1.0, 2.0, 3.0, 3.0, None]


def test_a_quiet_window_forgives():
    policy = RestartPolicy(0.5, 10.0)
    for t in range(5):
        policy.failed(t)
    assert policy.failed(400.0) == 0.5


def test_a_process_that_worked_for_20_s_was_sound():
    policy, now = RestartPolicy(0.5, 10.0), 0.0
    for _ in range(200):
        now += 30.0
        assert policy.failed(now, worked_s=29.0) == 0.5
    delays = [policy.failed(now + t, worked_s=19.0) for t in range(5)]
    assert delays == [1.0, 2.0, 4.0, 8.0, None]


@given(st.lists(st.floats(60.1, 1000.0), max_size=50))
def test_failures_more_than_a_minute_apart_never_give_up(gaps):
    policy, now = RestartPolicy(0.5, 10.0), 0.0
    for gap in gaps:
        now += gap
        delay = policy.failed(now)
        assert delay is not None
        assert 0.5 <= delay <= 10.0
