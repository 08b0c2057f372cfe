"""Checks of configuration values, which raise a UserError; a file of its own as all groups share them."""

from hsslam_node.errors import UserError


def expect_positive(config: object, group: str, *names: str) -> None:
    """Check that each of these fields is above 0."""
    for name in names:
        value = getattr(config, name)
        if not value > 0:
            raise UserError(f"{group}.{name} = {value}: expected a number above 0")


def expect_in_range(config: object, group: str, name: str, low: float, high: float) -> None:
    """Check that the field lies within low and high, both included."""
    value = getattr(config, name)
    if not low <= value <= high:
        raise UserError(f"{group}.{name} = {value}: expected {low} to {high}")


def expect_one_of(config: object, group: str, name: str, *known: int | str) -> None:
    """Check that the field has one of the known values."""
    value = getattr(config, name)
    if value not in known:
        raise UserError(f"{group}.{name} = {value}: expected {' or '.join(map(str, known))}")


def expect_not_negative(config: object, group: str, *names: str) -> None:
    """Check that each of these fields is 0 or more."""
    for name in names:
        value = getattr(config, name)
        if not value >= 0:
            raise UserError(f"{group}.{name} = {value}: expected 0 or more")
