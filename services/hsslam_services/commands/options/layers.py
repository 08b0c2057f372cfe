"""Merges options from several layers: defaults, files, the command line."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from hsslam_node.errors import UserError

_Options = TypeVar("_Options")


@dataclass(frozen=True)
class Layer:
    """The options that a file sets, by name (`slam.tracker.points`)."""

    place: str  # name of the file, for errors
    values: Mapping[str, Any]


def merged(start: _Options, layers: Sequence[Layer], given: Mapping[str, Any]) -> _Options:
    """`start` with the values of the layers; later layers override earlier ones, and `given` overrides all.

    The result is checked after all are merged, so that options that belong together are checked together.

    Raises:
        UserError: a value is not valid. If the files alone cause the error, it names the file.
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
    """The error of the options of the file that the command line does not override; "" if there is none."""
    try:
        changed(start, {name: v for name, v in layer.values.items() if name not in given})
    except UserError as error:
        return str(error)
    return ""


def changed(options: _Options, changes: Mapping[str, Any]) -> _Options:
    """The options with these values changed; checks each changed group again.

    Raises:
        UserError: a value is not valid.
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
