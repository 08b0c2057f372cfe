"""Options from several places, one over the other: defaults, files, the command line."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from hsslam_node.errors import UserError

_Options = TypeVar("_Options")


@dataclass(frozen=True)
class Layer:
    """Options that a file gives, and no others, by name (`slam.tracker.points`)."""

    place: str  # the file as the user knows it, for errors
    values: Mapping[str, Any]


def merged(start: _Options, layers: Sequence[Layer], given: Mapping[str, Any]) -> _Options:
    """`start` with the values of each layer over those of the layer before it, and `given` over all.

    Options that belong together are checked once all of them are known.

    Raises:
        UserError: a value that cannot be used. If the files alone cause the error, it names the file.
    """
    values = {name: value for layer in layers for name, value in layer.values.items()}
    try:
        return changed(start, {**values, **given})
    except UserError as error:
        for layer in layers:
            if message := _own_error(start, layer, given):
                raise UserError(f"{layer.place}: {message}") from None
        raise error from None


def _own_error(start: Any, layer: Layer, given: Mapping[str, Any]) -> str:
    """What is wrong with those options of the file that the command line does not override."""
    try:
        changed(start, {name: v for name, v in layer.values.items() if name not in given})
    except UserError as error:
        return str(error)
    return ""


def changed(options: _Options, changes: Mapping[str, Any]) -> _Options:
    """The options with other values for these names; every group that changes is checked anew.

    Raises:
        UserError: a value that cannot be used.
    """
    fields: dict[str, Any] = {}
    groups: dict[str, dict[str, Any]] = {}
    for name, value in changes.items():
        first, dot, rest = name.partition(".")
        if dot:
            groups.setdefault(first, {})[rest] = value
        else:
            fields[first] = value
    for name, inner in groups.items():
        fields[name] = changed(getattr(options, name), inner)
    return dataclasses.replace(options, **fields)  # type: ignore[type-var]
