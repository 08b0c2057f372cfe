"""Reads the files of `--config` as layers of options."""

import tomllib
import typing
from collections.abc import Iterator, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.user_path import user_path
from hsslam_services.commands.options.layers import Layer
from hsslam_services.commands.options.option_table import Option
from hsslam_services.run.config_file import CONFIG_FILE

_CAMERA = "camera:"
_CAMERAS = resources.files("hsslam_services.run").joinpath("cameras")
_EXPECTED = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


def read_layer(place: str, table: Sequence[Option]) -> Layer:
    """The options of a TOML file, of a run folder (its config.toml), or of a camera preset.

    Raises:
        UserError: no such file, not TOML, an unknown option (the nearest is suggested), or a value of
            the wrong kind.
    """
    if place.startswith(_CAMERA):
        name, text = place, _camera_text(place)
    else:
        path = user_path(place)
        path = path / CONFIG_FILE if path.is_dir() else path
        name, text = str(path), _file_text(path)
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f'{name}: {error}: expected TOML, as pace = "lockstep"') from None
    except (ValueError, RecursionError):
        raise UserError(
            f"{name}: a number is too long, or brackets are too deep: expected TOML of options"
        ) from None
    known = {o.name: o for o in table if not o.is_positional and o.name != "config"}
    return Layer(name, dict(_values(name, document, "", known)))


def camera_names() -> list[str]:
    """The camera presets, sorted: kinect-v1, ..."""
    files = (Path(file.name) for file in _CAMERAS.iterdir())
    return sorted(file.stem for file in files if file.suffix == ".toml")


def _camera_text(place: str) -> str:
    name, known = place.removeprefix(_CAMERA), camera_names()
    if name not in known:
        expected = f"expected {_CAMERA}{' or '.join(known)}{did_you_mean(name, known)}"
        raise UserError(f"--config {place}: {expected}")
    return _CAMERAS.joinpath(f"{name}.toml").read_text()


def _file_text(path: Path) -> str:
    expected = f"expected a TOML file, a run folder with {CONFIG_FILE}, or camera:NAME"
    try:
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UserError(f"--config {path}: {error.strerror}: {expected}") from None
    except UnicodeDecodeError:
        raise UserError(f"--config {path}: not UTF-8 text: {expected}") from None


def _values(
    place: str, found: Mapping[str, Any], prefix: str, known: Mapping[str, Option]
) -> Iterator[tuple[str, Any]]:
    groups = {name.rpartition(".")[0] for name in known}
    groups |= {group.rpartition(".")[0] for group in groups}
    for key, value in found.items():
        name = prefix + key.replace("-", "_")
        if name in known:
            yield name, _value(place, known[name], value)
        elif isinstance(value, Mapping) and name in groups:
            yield from _values(place, value, f"{name}.", known)
        else:
            given = _as_in_file(name, value)
            raise UserError(f"{place}: {given}: unknown option{_nearest(name, known)}")


def _value(place: str, option: Option, value: Any) -> Any:
    try:
        return msgspec.convert(value, option.kind)
    except msgspec.ValidationError:
        hint = did_you_mean(str(value), option.words)
        raise UserError(
            f"{place}: {_as_in_file(option.name, value)}: expected {_expected(option.kind)}{hint}"
        ) from None


def _as_in_file(name: str, value: Any) -> str:
    """The line of the file; of a table only its name."""
    if isinstance(value, Mapping):
        return f"[{name}]"
    if isinstance(value, bool):
        return f"{name} = {str(value).lower()}"
    if isinstance(value, str):
        return f'{name} = "{value}"'
    return f"{name} = {value}"


def _expected(kind: Any) -> str:
    if typing.get_origin(kind) is tuple:
        one, *more = typing.get_args(kind)
        count = "a list of" if more == [Ellipsis] else f"a list of {1 + len(more)}:"
        return f"{count} {_expected(one)}"
    return _EXPECTED.get(kind) or " or ".join(map(str, typing.get_args(kind)))


def _nearest(name: str, known: Mapping[str, Option]) -> str:
    """A suggestion; an option of the same name in another group goes before a similar name."""
    leaf = name.rpartition(".")[2]
    same_leaf = [option for option in known if option.rpartition(".")[2] == leaf]
    hint = did_you_mean(name, same_leaf or known, cutoff=0.0 if same_leaf else 0.5)
    return hint or "; see hsslam-serve --help-all"
