"""Driver package and camera, either of which may be missing; apart, as each camera source asks for both."""

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
            f"source {kind}: package {package} is not there: pip install 'hsslam-node[{kind}]'"
        ) from None


def chosen_camera(kind: str, found: Sequence[str], number: str, asked: str, plug: str) -> str:
    """Of the cameras that were found, the one of this number, or the first if it is empty.

    asked: how the user gave the number. plug: where a camera of this kind is plugged in.

    Raises:
        UserError: there is none, or not this one.
    """
    if not found:
        raise UserError(f"source {kind}: no camera: expected one on {plug}, and rights to use it")
    if number and number not in found:
        raise UserError(f"{asked}: expected one of {', '.join(found)}")
    return number or found[0]
