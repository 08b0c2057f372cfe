"""Finds the driver package and the camera of a source; alone, as all camera sources use it."""

import importlib
from collections.abc import Sequence
from typing import Any

from hsslam_node.errors import UserError


def driver(kind: str, module: str, package: str) -> Any:
    """The module of a driver, which the extra `kind` installs.

    Raises:
        UserError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise UserError(
            f"source {kind}: package {package} is missing: pip install 'hsslam-node[{kind}]'"
        ) from None


def chosen_camera(kind: str, found: Sequence[str], number: str, asked: str, plug: str) -> str:
    """The camera of this number among those found, or the first if it is empty.

    asked: the user's source or option, for errors. plug: where a camera of this kind is plugged in.

    Raises:
        UserError: there is none, or not this one.
    """
    if not found:
        raise UserError(f"source {kind}: no camera: expected one on {plug} that you may access")
    if number and number not in found:
        raise UserError(f"{asked}: expected one of {', '.join(found)}")
    return number or found[0]
