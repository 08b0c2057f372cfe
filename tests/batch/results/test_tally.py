"""Counts of a batch are by frames; the rest is told at the pace so far."""

from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from hsslam_batch.attempt.outcome import Kind
from hsslam_batch.plan.log import read_manifest
from hsslam_batch.results import tally as module
from hsslam_batch.results.tally import Tally, duration
from tests.batch.outcomes import outcome, planned


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time of the clock, s, which the test sets."""
    clock = [1000.0]
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: clock[0]))
    return clock


def test_frames_and_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    batch = planned(tmp_path / "out", frames=(100, 200, 0))  # the last is not known: 150
    now = iter((1000.0, 1010.0, 1010.0, 1020.0, 1020.0))
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: next(now)))
    tally = Tally(read_manifest(batch.out), [outcome(batch, 0)])
    assert (tally.done, tally.left, tally.frames, tally.frames_done) == (1, 2, 450, 100)
    assert tally.rest_s() is None
    tally.run({"id1": 950, "id2": 50})  # no more than a log has
    assert tally.frames_done == 350
    assert tally.rest_s() == pytest.approx(10.0 / 250 * 100)
    assert tally.line() == "1 done, 0 failed, 2 left; 350 of 450 frames; about 4 s left"
    tally.settle(outcome(batch, 1, "crash", frames=40))
    tally.run({})
    assert (tally.failed, tally.frames_done) == (1, 300)
    assert tally.rest_s() == pytest.approx(20.0 / 40 * 150)  # it has made no more


def test_logs_that_fail_at_once_say_nothing_of_the_pace(tmp_path: Path, now: list[float]):
    batch = planned(tmp_path / "out", frames=(1000,) * 10)
    tally = Tally(read_manifest(batch.out), [])
    for k in range(5):
        tally.settle(outcome(batch, k, "bad input"))
    now[0] = 1100.0
    assert tally.frames_done == 5000 and tally.rest_s() is None
    tally.settle(outcome(batch, 5, frames=1000))
    assert tally.rest_s() == pytest.approx(100.0 / 1000 * 4000)


@pytest.mark.parametrize(("kind", "frames"), [("done", 120), ("bad input", 0)])
def test_a_log_of_unknown_length_counts_with_the_frames_that_it_had(
    tmp_path: Path, kind: Kind, frames: int
):
    batch = planned(tmp_path / "out", frames=(100, 200, 0))
    tally = Tally(read_manifest(batch.out), [])
    assert tally.frames == 450
    tally.settle(msgspec.structs.replace(outcome(batch, 2, kind), frames=frames))
    assert (tally.frames, tally.frames_done) == (300 + frames, frames)


def test_logs_of_unknown_length_are_as_long_as_those_that_are_done(
    tmp_path: Path, now: list[float]
):
    """As logs of a store are: no plan knows their length."""
    batch = planned(tmp_path / "out", frames=(0,) * 100)
    tally = Tally(read_manifest(batch.out), [])
    tally.run({"id0": 300, "id1": 300})
    assert tally.rest_s() is None
    assert tally.line() == "0 done, 0 failed, 100 left; 600 frames"
    now[0] = 1200.0
    for k in range(2):
        tally.settle(outcome(batch, k, frames=600))
    assert (tally.frames, tally.frames_done) == (60_000, 1200)
    assert tally.rest_s() == pytest.approx(200.0 / 2 * 98)
    tally.settle(outcome(batch, 2, "bad input"))  # says nothing of the others
    tally.run({"id3": 1600})  # longer than the others
    assert (tally.frames, tally.frames_done) == (99 * 600 + 1000, 2800)


def test_durations_in_words():
    assert [duration(s) for s in (20, 100, 3599, 7800, 90_000)] == [
        *("20 s", "2 min", "60 min", "2 h 10 min", "25 h 00 min")
    ]
