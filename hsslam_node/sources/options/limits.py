"""Limits of the numbers in options; alone because all groups of options use it."""

from hsslam_node.errors import UserError


def expect_range(option: str, value: float, low: float, high: float) -> None:
    """UserError if the value of `--option` is outside."""
    if not low <= value <= high:  # nan is not
        raise UserError(f"--{option} {value}: expected {low} to {high}")
