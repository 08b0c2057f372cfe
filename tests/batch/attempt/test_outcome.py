"""Which failures are worth another attempt, and what a summary says."""

import pytest

from hsslam_batch.attempt.outcome import Outcome, figures, may_try_again


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


def test_figures_of_a_summary():
    gaps = [{"gap_frames": gap, "depth_median_m": gap / 1e3} for gap in (10, 30, 100)]
    summary = {
        "frames": {"in": 9, "tracked": 8, "lost": 1, "bad": 0},
        "sensor_s": 0.3,
        "keyframes": 3,
        "mesh": {"vertices": 5, "faces": 7},
        "evaluation": {"ate": {"final": {"rmse_m": 0.01}}, "consistency": {"final": gaps}},
    }
    assert figures(summary) == {
        "log_s": 0.3,
        "frames": 9,
        "tracked": 8,
        "lost": 1,
        "keyframes": 3,
        "ate_m": 0.01,
        "consistency_m": 0.03,
        "mesh_faces": 7,
    }
    assert figures({})["ate_m"] is None
