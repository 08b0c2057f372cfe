"""`config.toml`: the effective options of a run; apart from `options`, which writes no TOML."""

import dataclasses
from typing import Any

import tomli_w

from hsslam_services.run.options import ServeOptions

CONFIG_FILE = "config.toml"
_NOT_REPEATED = ("out", "config")  # a repeated run must not overwrite the original


def config_text(options: ServeOptions) -> str:
    """The options as TOML, a table for each group; options without a value (None) are left out."""
    fields = dataclasses.asdict(options)
    for name in _NOT_REPEATED:
        del fields[name]
    return tomli_w.dumps(_without_none(fields))


def _without_none(fields: dict[str, Any]) -> dict[str, Any]:
    return {
        name: _without_none(value) if isinstance(value, dict) else value
        for name, value in fields.items()
        if value is not None
    }
