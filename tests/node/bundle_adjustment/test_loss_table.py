"""Which keyframes a round takes: the worst above the threshold that do not rest."""

import numpy as np
import pytest

from hsslam_node.bundle_adjustment.global_ba import LossTable
from hsslam_node.config import BundleAdjustmentConfig


def _table(cooldown_rounds: int = 2) -> LossTable:
    config = BundleAdjustmentConfig(
        loss_threshold=1.0, top_keyframes=3, cooldown_rounds=cooldown_rounds
    )
    return LossTable(config)


def test_nothing_is_selected_from_nothing():
    assert len(_table().select()) == 0


def test_the_worst_above_the_threshold_come_first():
    table = _table()
    table.update(np.array([9, 2, 5, 4, 0]), np.array([3.0, 0.9, 7.0, 2.0, 5.0]))
    assert table.select().tolist() == [5, 0, 9]
    assert table.mean(np.array([5, 9])) == 5.0


def test_at_the_threshold_or_unmeasured_is_not_selected():
    table = _table()
    table.update(np.array([3, 1]), np.array([1.0, np.nan]))
    assert len(table.select()) == 0


def test_a_newer_loss_replaces_the_older():
    table = _table()
    table.update(np.array([1, 2]), np.array([5.0, 4.0]))
    table.update(np.array([1]), np.array([0.5]))
    assert table.select().tolist() == [2]


@pytest.mark.parametrize("rounds", [0, 1, 3])
def test_refined_keyframes_rest(rounds):
    table = _table(rounds)
    table.update(np.arange(4), np.array([9.0, 8.0, 7.0, 6.0]))
    assert table.select().tolist() == [0, 1, 2]
    table.rest(np.array([0, 1, 2]))
    for _ in range(rounds):
        assert table.select().tolist() == [3]
    assert table.select().tolist() == [0, 1, 2]
