"""Changes to a configuration by name: `field.plane_channels` = 16."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import msgspec

from hsslam_node.config import SlamConfig
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.services.bench.tables.paper_tables import TWICE, Override


def with_overrides(config: SlamConfig, overrides: Mapping[str, Override]) -> SlamConfig:
    """The configuration with `{"group.field": value}` changed; `TWICE` doubles the value there is.

    Raises:
        UserError: no such parameter (the nearest is suggested), or a value it cannot have.
    """
    changed: dict[str, dict[str, Any]] = {}
    for name, value in overrides.items():
        group, field = _known(config, name)
        old = getattr(getattr(config, group), field.name)
        new = 2 * old if value == TWICE else value
        try:
            changed.setdefault(group, {})[field.name] = msgspec.convert(
                new, type(old), strict=not isinstance(new, str)
            )
        except msgspec.ValidationError:
            raise UserError(f"{name} = {value}: expected {_kind(old)}, as {old}") from None
    groups = {g: dataclasses.replace(getattr(config, g), **new) for g, new in changed.items()}
    return dataclasses.replace(config, **groups)


def parsed_overrides(texts: tuple[str, ...]) -> dict[str, Override]:
    """`("mapper.rays=500",)` as a mapping; values stay text until the parameter's type is known.

    Raises:
        UserError: no `=` in it.
    """
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise UserError(f"--set {text}: expected GROUP.FIELD=VALUE, as mapper.rays=500")
        pairs[name] = value
    return pairs


def _known(config: SlamConfig, name: str) -> tuple[str, dataclasses.Field]:
    known = {
        f"{group.name}.{field.name}": (group.name, field)
        for group in dataclasses.fields(config)
        for field in dataclasses.fields(getattr(config, group.name))
    }
    plain = name.replace("-", "_")
    if plain not in known:
        hint = did_you_mean(plain, known)
        raise UserError(f"{name}: expected a parameter, as mapper.rays{hint}")
    return known[plain]


def _kind(value: object) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number"}.get(
        type(value), "a word"
    )
