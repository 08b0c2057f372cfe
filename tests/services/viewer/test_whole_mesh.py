from pathlib import Path

from hsslam_proto.envelope import Envelope
from hsslam_services.viewer.whole_mesh import WholeMesh
from tests.services.wire_samples import blocks, pose

_FIRST, _SECOND = Path("run.mcap"), Path("run.1.mcap")
_SENT = Envelope(publisher=1, sequence=1, stamp_ns=1, publish_ns=1)


def test_a_new_part_asks_for_all_blocks_once():
    whole = WholeMesh(_FIRST, 0.0)
    assert [whole.is_due(part, 20.0) for part in (_FIRST, _SECOND, _SECOND)] == [False, True, False]


def test_parts_that_the_answers_fill_ask_every_ten_seconds():
    whole, parts = WholeMesh(_FIRST, 0.0), 1
    due = []
    for now_s in range(1, 40):
        if whole.is_due(Path(f"run.{parts}.mcap"), now_s):
            due.append(now_s)
            parts += 1
    assert due == [10, 20, 30]
    assert whole.is_for_file(blocks(1), None)


def test_a_part_of_hours_asks_every_ten_minutes():
    whole = WholeMesh(_FIRST, 0.0)
    due = [now_s for now_s in range(0, 3600, 10) if whole.is_due(_FIRST, now_s)]
    assert due == [600, 1200, 1800, 2400, 3000]


def test_the_first_answer_is_drawn_and_in_run_rrd():
    whole = WholeMesh(_FIRST, 0.0)
    assert whole.is_for_viewer(blocks(1), None) and whole.is_for_file(blocks(1), None)


def test_an_answer_to_a_new_part_fills_its_file_and_is_not_drawn_again_before_ten_minutes():
    whole = WholeMesh(_FIRST, 0.0)
    assert whole.is_due(_SECOND, 60.0)
    assert whole.is_for_file(blocks(1), None) and not whole.is_for_viewer(blocks(1), None)


def test_after_ten_minutes_the_viewer_draws_all_blocks_and_the_file_has_them():
    whole = WholeMesh(_FIRST, 0.0)
    assert whole.is_due(_FIRST, 660.0)
    assert whole.is_for_viewer(blocks(1), None) and not whole.is_for_file(blocks(1), None)


def test_what_is_news_is_always_drawn():
    whole = WholeMesh(_FIRST, 0.0)
    assert whole.is_due(_FIRST, 660.0)
    assert whole.is_due(_SECOND, 670.0)
    for message, envelope in ((blocks(1), _SENT), (pose(0), None)):
        assert whole.is_for_viewer(message, envelope) and whole.is_for_file(message, envelope)
