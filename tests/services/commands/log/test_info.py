"""Spans of channels from the indexes are those of the messages themselves."""

from collections import defaultdict

import pytest
from mcap.reader import make_reader

from hsslam_services.commands.log.info import channel_spans
from tests.services.log.sample_log import write_log


def test_spans_are_those_of_the_messages(tmp_path):
    times = defaultdict(list)
    with write_log(tmp_path).open("rb") as stream:
        reader = make_reader(stream)
        for _, channel, message in reader.iter_messages():
            times[channel.id].append(message.log_time)
        summary = reader.get_summary()
        assert summary is not None
        found = channel_spans(stream, summary)
    expected = {channel: (max(ns) - min(ns)) / 1e9 for channel, ns in times.items()}
    assert found == pytest.approx(expected)
    assert max(found.values()) > min(found.values())
