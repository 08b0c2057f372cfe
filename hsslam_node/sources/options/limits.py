"""Limits of the numbers in options; alone because all groups of options use it."""

import math

from hsslam_node.errors import UserError


def expect_range(option: str, value: float, low: float, high: float) -> None:
    """UserError if the value of `--option` is outside."""
    if not low <= value <= high:  # nan is not
        raise UserError(f"--{option} {value}: expected {low} to {high}")


def expect_at_least(option: str, value: float, least: float, unit: str = "") -> None:
    """UserError if the value of `--option`, in this unit if it has one, is smaller, or not finite."""
    if not (math.isfinite(value) and value >= least):
        of_unit = f"{unit}, " if unit else ""
        raise UserError(f"--{option} {value}: expected {of_unit}{least} or more")
