"""Records of a log in the order in which they came."""

from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Channel, Message

from hsslam_services.log.reading.arrival_order import Record, in_order_of_arrival

_CHANNELS = st.integers(0, 2)
_S = 10**9


def _record(channel: int, log_ns: int, number: int) -> Record:
    return (
        None,
        Channel(channel, f"topic {channel}", "msgpack", {}, 0),
        Message(channel, log_ns, b"", log_ns, number),
        None,
    )


def _numbers(records: list[Record]) -> list[int]:
    return [message.sequence for _, _, message, _ in in_order_of_arrival(records)]


@given(st.lists(st.tuples(_CHANNELS, st.integers(-3600 * _S, 3600 * _S))))
def test_a_clock_that_is_set_costs_no_record_and_no_order_within_a_channel(steps):
    now_ns, records = 10**18, []
    for number, (channel, step_ns) in enumerate(steps):
        now_ns += step_ns
        records.append(_record(channel, now_ns, number))
    found = _numbers(records)
    assert sorted(found) == list(range(len(records)))
    for channel in range(3):
        of_channel = [k for k in found if steps[k][0] == channel]
        assert of_channel == sorted(of_channel)


@given(st.lists(st.tuples(st.integers(0, _S // 2), st.integers(0, _S // 2))))
def test_records_that_are_written_late_come_by_their_time(steps):
    """Frames are written up to half a second after poses that came later."""
    now_ns, records = 10**18, []
    for number, (step_ns, late_ns) in enumerate(steps):
        now_ns += step_ns
        records.append((now_ns + late_ns, _record(number, now_ns, number)))
    as_written = [record for _, record in sorted(records, key=lambda each: each[0])]
    found = [record[2].log_time for record in in_order_of_arrival(as_written)]
    assert found == sorted(found)


def test_what_came_before_the_clock_was_set_back_comes_first():
    before = [_record(k % 2, 10**18 + k, k) for k in range(10)]
    after = [_record(k % 2, 10**18 - 3600 * _S + k, k) for k in range(10, 20)]
    assert _numbers(before + after) == list(range(20))
