"""The loop of a batch keeps its pool full, tries again what it is told to, and stops in order."""

import itertools
from collections.abc import Iterator

from hsslam_batch.cluster.drive import Try, drive
from hsslam_batch.cluster.task import TaskResult


class Slots:
    """A pool whose attempts end one after the other, the oldest first."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.started: list[Try] = []
        self.flying: list[Try] = []

    def has_room(self) -> bool:
        return len(self.flying) < self.count

    def start(self, one: Try) -> None:
        self.started.append(one)
        self.flying.append(one)

    def is_busy(self) -> bool:
        return bool(self.flying)

    def ended(self, timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        yield self.flying.pop(0), TaskResult(node_id="here")


def test_all_that_wait_are_started_and_never_more_than_fit():
    pool, most = Slots(3), []
    waiting = (Try(k) for k in range(10_000))

    def judge(one: Try, result: TaskResult) -> None:
        most.append(len(pool.flying) + 1)

    drive(waiting, pool, judge, lambda: False)
    assert [one.index for one in pool.started] == list(range(10_000))
    assert max(most) == 3


def test_what_is_tried_again_goes_before_what_waits():
    pool = Slots(1)

    def judge(one: Try, result: TaskResult) -> Try | None:
        again = one.index == 0 and one.attempt < 3
        return Try(0, one.attempt + 1, result.node_id) if again else None

    drive(map(Try, range(3)), pool, judge, lambda: False)
    assert pool.started == [Try(0), Try(0, 2, "here"), Try(0, 3, "here"), Try(1), Try(2)]


def test_once_it_stops_nothing_begins_and_what_runs_ends():
    pool, ended = Slots(2), []
    looks = []

    def judge(one: Try, result: TaskResult) -> Try | None:
        ended.append(one.index)
        return Try(one.index, 2)

    seconds = itertools.count()

    def look() -> None:
        looks.append(len(ended))

    drive(map(Try, range(10)), pool, judge, lambda: bool(ended), look, lambda: next(seconds))
    assert [one.index for one in pool.started] == [0, 1] and ended == [0, 1]
    assert looks == [1, 2]


def test_it_looks_twice_a_second_however_many_end():
    pool, looks, tenths = Slots(4), [], itertools.count()

    def look() -> None:
        looks.append(len(pool.started))

    drive(
        map(Try, range(1000)), pool, lambda *_: None, lambda: False, look, lambda: next(tenths) / 10
    )
    assert len(looks) == 200  # one ends in a tenth of a second


def test_what_waits_gets_a_node_that_comes_late():
    """The last node goes while the first attempt runs, and another comes after three looks."""
    pool, looks = Slots(1), []

    def judge(one: Try, result: TaskResult) -> Try | None:
        pool.count = 0
        return Try(0, 2) if one.attempt == 1 and one.index == 0 else None

    def ended(timeout_s: float) -> Iterator[tuple[Try, TaskResult]]:
        if pool.flying:
            yield pool.flying.pop(0), TaskResult(is_lost=True)

    def look() -> None:
        looks.append(len(pool.started))
        pool.count = 1 if len(looks) % 4 == 0 else pool.count

    pool.ended = ended
    seconds = itertools.count()
    drive(map(Try, range(2)), pool, judge, lambda: False, look, lambda: next(seconds))
    assert pool.started == [Try(0), Try(0, 2), Try(1)]
    assert looks.count(1) >= 3


def test_what_waits_for_a_node_can_be_stopped():
    pool, looks = Slots(0), []
    pool.ended = lambda timeout_s: iter(())
    seconds = itertools.count()
    drive(
        [Try(0)], pool, lambda *_: None, lambda: len(looks) > 2, lambda: looks.append(1),
        lambda: next(seconds),
    )  # fmt: skip
    assert not pool.started
