"""Means, deviations, and the comparison with the paper's order."""

import math

import pytest

from hsslam_bench.tables.figures import disagreements, markdown_table, measured_rows
from hsslam_bench.tables.paper_tables import ABLATION, TUM
from hsslam_bench.tables.plan import RunResult

FULL, A = ABLATION.rows[:2]


def _result(row: str, seed: int, sequence: str = "house", error: str = "", **values) -> RunResult:
    return RunResult(
        key=f"{row}{sequence}{seed}",
        row=row,
        sequence=sequence,
        seed=seed,
        protocol="preset paper",
        commit="c",
        values=values,
        error=error,
    )


def test_mean_and_deviation_are_over_seeds():
    results = [_result("full", seed, ate_cm=value) for seed, value in enumerate((1.0, 2.0, 4.0))]
    (row,) = measured_rows(ABLATION, [FULL], results, "HS-SLAM")
    figure = row.figures["ate_cm"]
    assert figure.mean == pytest.approx(7 / 3)
    assert figure.deviation == pytest.approx(math.sqrt((16 / 9 + 1 / 9 + 25 / 9) / 2))
    assert row.paper["ate_cm"] == 0.528


def test_sequences_are_averaged_within_a_seed_first():
    results = [
        _result("full", seed, sequence, ate_cm=value)
        for seed, sequence, value in ((0, "a", 1.0), (0, "b", 3.0), (1, "a", 2.0), (1, "b", 2.0))
    ]
    (row,) = measured_rows(ABLATION, [FULL], results, "HS-SLAM")
    assert row.figures["ate_cm"].mean == 2.0
    assert row.figures["ate_cm"].deviation == 0.0
    (row,) = measured_rows(ABLATION, [FULL], results[:3], "HS-SLAM")  # seed 1 lacks a sequence
    assert (row.figures["ate_cm"].mean, row.figures["ate_cm"].seeds) == (2.0, 1)


def test_what_failed_or_is_missing_is_no_figure():
    results = [_result("full", 0, error="killed"), _result("full", 1, ate_cm=float("nan"))]
    (row,) = measured_rows(ABLATION, [FULL], results, "HS-SLAM")
    assert not row.figures
    (row,) = measured_rows(ABLATION, [FULL], results[:1], "HS-SLAM")
    assert row.note == "no result"
    results = [_result("full", 0, ate_cm=1.0), _result("full", 1, ate_cm=1.0)]
    rows = measured_rows(ABLATION, [FULL, A], [*results, _result("A", 1, ate_cm=1.0)], "HS-SLAM")
    assert [row.note for row in rows] == ["", "1 of 2 seeds"]


def test_the_mean_of_a_table_tells_how_many_rows_it_is_of():
    results = [
        _result(name, seed, name, ate_cm=value)
        for seed in (0, 1)
        for name, value in (("fr1/desk", 1.0), ("fr2/xyz", 2.0 + seed))
    ]
    *rows, mean = measured_rows(TUM, TUM.rows, results, "Co-SLAM")
    assert [row.paper["ate_cm"] for row in rows] == [2.754, 1.747, 3.293]
    assert mean.note == "of 2/3"
    assert mean.figures["ate_cm"].mean == pytest.approx((1.5 + 2.0) / 2)
    assert mean.paper["ate_cm"] == 2.598


def test_only_differences_beyond_the_deviation_disagree():
    def rows(full: tuple[float, float], a: tuple[float, float], metric: str):
        results = [_result("full", s, **{metric: v}) for s, v in enumerate(full)]
        results += [_result("A", s, **{metric: v}) for s, v in enumerate(a)]
        return measured_rows(ABLATION, [FULL, A], results, "HS-SLAM")

    def told(*arguments) -> list[str]:
        return disagreements(rows(*arguments), ABLATION.metrics)

    assert told((1.0, 1.2), (1.9, 2.1), "ate_cm") == []  # worse, as in the paper
    assert told((1.0, 1.6), (0.9, 1.5), "ate_cm") == []  # better, by less than the deviation
    (line,) = told((1.9, 2.1), (1.0, 1.2), "ate_cm")
    assert "(A) only hash grid" in line and "ate_cm better (1.1 ± 0.14 against 2 ± 0.14" in line
    assert "paper 1.073 against 0.528" in line
    assert told((2.0,), (1.0,), "ate_cm") == []  # one seed has no deviation
    assert told((1.9, 2.1, 2.0), (1.0, 1.2), "ate_cm") == []  # other seeds
    assert told((90.0, 90.1), (80.0, 80.1), "completion_lit_pct") == []  # worse: more is better
    assert len(told((90.0, 90.1), (95.0, 95.1), "completion_lit_pct")) == 1
    assert told((90.0, 90.1), (95.0, 95.1), "completion_pct") == []  # not the paper's protocol
    (full, a) = rows((1.9, 2.1), (1.0, 1.2), "ate_cm")
    assert disagreements([a, full], ABLATION.metrics) != []  # in any order
    assert disagreements([a, a], ABLATION.metrics) == []  # the full model was not asked for


def test_means_over_other_sequences_are_marked_and_not_compared():
    """(A) fails on kitchen, where the error is larger."""
    results = [
        _result("full", seed, sequence, ate_cm=value + 0.01 * seed)
        for seed in (0, 1)
        for sequence, value in (("house", 0.9), ("kitchen", 2.6))
    ]
    results += [_result("A", seed, ate_cm=0.91 + 0.01 * seed) for seed in (0, 1)]
    results += [_result("A", seed, "kitchen", error="lost") for seed in (0, 1)]
    rows = measured_rows(ABLATION, [FULL, A], results, "HS-SLAM")
    full, a = markdown_table(rows, ABLATION.metrics).splitlines()[2:]
    assert "1.755 ± 0.007 (0.528)" in full
    assert "0.915 ± 0.007, 1 of 2 sequences (1.073)" in a
    assert disagreements(rows, ABLATION.metrics) == []


def test_a_scene_without_a_mesh_is_marked_in_the_mean():
    results = [_result(name, 0, name, ate_cm=1.0) for name in ("fr1/desk", "fr2/xyz")]
    results[0].values["lost"] = 2.0
    mean = measured_rows(TUM, TUM.rows, results, "Co-SLAM")[-1]
    (line,) = markdown_table([mean], ["ate_cm", "lost"]).splitlines()[2:]
    assert "| 1.000 (2.598) | 2.0, 1 of 2 sequences |" in line
