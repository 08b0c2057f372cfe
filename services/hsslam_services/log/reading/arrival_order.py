"""Sorts the records of a log by their time of arrival, also if the wall clock was set back meanwhile; apart
from the reader, as it opens no file."""

import heapq
from collections.abc import Iterable, Iterator

from mcap.records import Channel, Message, Schema

# the last: byte at which its chunk begins; None: that tells nothing of the order
Record = tuple[Schema | None, Channel, Message, int | None]

LATEST_NS = 10**9  # by which the recorder writes a record later than others that came after it


def in_order_of_arrival(records: Iterable[Record]) -> Iterator[Record]:
    """Sort records, which come in the order of the file; holds those of the last second.

    The records of a channel keep the order of the file, in which they came. A record that is more than a
    second older than one before it shows that the wall clock was set back: all records before it come first.
    """
    waiting: list[tuple[int, int, Record]] = []  # heap: time, place in the file
    newest_ns: dict[int, int] = {}  # by channel
    latest_ns = 0
    for place, record in enumerate(records):
        log_ns, channel = record[2].log_time, record[2].channel_id
        if log_ns < latest_ns - LATEST_NS:
            yield from _all_of(waiting)
            newest_ns.clear()
            latest_ns = log_ns
        latest_ns = max(latest_ns, log_ns)
        newest_ns[channel] = max(newest_ns.get(channel, 0), log_ns)
        heapq.heappush(waiting, (newest_ns[channel], place, record))
        while waiting[0][0] < latest_ns - LATEST_NS:
            yield heapq.heappop(waiting)[2]
    yield from _all_of(waiting)


def _all_of(waiting: list[tuple[int, int, Record]]) -> Iterator[Record]:
    while waiting:
        yield heapq.heappop(waiting)[2]
