"""Checks of configuration values, which raise a UserError; a file of its own as all groups share them."""

from hsslam_node.errors import UserError

_LARGEST = 1e9  # of any value: more overflows somewhere, long after the start


def expect_positive(config: object, group: str, *names: str) -> None:
    """Check that each of these fields is above 0, and not absurdly large."""
    for name in names:
        value = getattr(config, name)
        if not 0 < value <= _LARGEST:
            raise UserError(
                f"{group}.{name} = {value}: expected a number above 0, at most {_LARGEST:g}"
            )


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
    """Check that each of these fields is 0 or more, and not absurdly large."""
    for name in names:
        value = getattr(config, name)
        if not 0 <= value <= _LARGEST:
            raise UserError(f"{group}.{name} = {value}: expected 0 or more, at most {_LARGEST:g}")
