"""Reads `camera.json` (TUM layout, plain folders) and `cam_params.json` (Replica layout)."""

import difflib
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from hsslam_node.errors import UserError
from hsslam_node.geometry.camera import Camera

_TUM_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "distortion", "depth_scale")


def read_tum_camera(path: Path) -> tuple[Camera, float]:
    """Camera (with its distortion) and depth units per metre of a `camera.json`.

    Keys: width, height, fx, fy, cx, cy in pixels; distortion (k1 k2 p1 p2 [k3], default none);
    depth_scale (PNG units per metre, default 5000).

    Raises:
        UserError: the file cannot be read, or a field is missing, unknown or not a finite number.
    """
    return _tum_camera(path, {"depth_scale": 5000.0} | _read_object(path))


def read_record_camera(
    path: Path, given: dict[str, object], size: tuple[int, int]
) -> tuple[Camera, float]:
    """The same for a plain folder of images (width, height in pixels), whose `camera.json` may be missing.

    `given` goes before the file. Without fy it is fx, without cx, cy they are the middle of the image.

    Raises:
        UserError: as `read_tum_camera`; names all that is missing; the file is for another size.
    """
    fields = (_read_object(path) if path.exists() else {}) | given
    missing = [key for key in ("fx", "depth_scale") if key not in fields]
    if missing:
        verb = "are" if len(missing) > 1 else "is"
        options = ", ".join(f"--camera.{key.replace('_', '-')}" for key in missing)
        raise UserError(
            f"{path.parent}: {' and '.join(missing)} {verb} missing: expected in {path.name} (with fy, cx, "
            f"cy) or as {options}"
        )
    width, height = size
    middle = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    sized = {"width": width, "height": height, "fy": fields["fx"]} | middle | fields
    camera, scale = _tum_camera(path, sized)
    if (camera.width_px, camera.height_px) != size:
        raise UserError(
            f"{path}: {camera.width_px}x{camera.height_px} pixels, images have {width}x{height}: "
            "expected the camera of these images"
        )
    return camera, scale


def read_replica_camera(path: Path) -> tuple[Camera, float]:
    """Camera and depth units per metre of a `cam_params.json`: {"camera": {w, h, fx, fy, cx, cy,
    scale}}.

    Raises:
        UserError: the file cannot be read, or a field is missing or not a finite number.
    """
    fields = _read_object(path).get("camera")
    if not isinstance(fields, dict):
        raise UserError(f"{path}: field 'camera' is missing: expected w, h, fx, fy, cx, cy, scale")
    return _camera(path, fields, "w", "h"), _positive(path, fields, "scale")


def _tum_camera(path: Path, fields: dict[str, Any]) -> tuple[Camera, float]:
    for key in fields:
        if key not in _TUM_KEYS:
            near = difflib.get_close_matches(key, _TUM_KEYS, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise UserError(f"{path}: unknown field {key!r}: expected {', '.join(_TUM_KEYS)}{hint}")
    distortion = fields.get("distortion", [])
    if not isinstance(distortion, list) or len(distortion) not in (0, 4, 5):
        raise UserError(f"{path}: distortion = {distortion}: expected [] or [k1, k2, p1, p2, k3]")
    for value in distortion:
        _finite(path, "distortion", value)
    coefficients = tuple(float(v) for v in distortion) if any(distortion) else ()
    camera = replace(_camera(path, fields, "width", "height"), distortion=coefficients)
    return camera, _positive(path, fields, "depth_scale")


def _camera(path: Path, fields: dict[str, Any], width: str, height: str) -> Camera:
    """The pinhole camera of these fields; its size under these names."""
    return Camera(
        width_px=_positive_int(path, fields, width),
        height_px=_positive_int(path, fields, height),
        fx=_positive(path, fields, "fx"),
        fy=_positive(path, fields, "fy"),
        cx=_number(path, fields, "cx"),
        cy=_number(path, fields, "cy"),
    )


def _read_object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text())
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}): expected the camera") from None
    except ValueError as error:
        raise UserError(f"{path}: not JSON ({error}): expected the camera") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: holds a {type(content).__name__}: expected a JSON object")
    return content


def _number(path: Path, fields: dict[str, Any], key: str) -> float:
    if key not in fields:
        raise UserError(f"{path}: field {key!r} is missing: expected a finite number")
    return _finite(path, key, fields[key])


def _finite(path: Path, key: str, value: Any) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        raise UserError(f"{path}: {key} = {value}: expected a finite number")
    return float(value)


def _positive(path: Path, fields: dict[str, Any], key: str) -> float:
    value = _number(path, fields, key)
    if value <= 0:
        raise UserError(f"{path}: {key} = {value:g}: expected a number above 0")
    return value


def _positive_int(path: Path, fields: dict[str, Any], key: str) -> int:
    value = _positive(path, fields, key)
    if value != int(value):
        raise UserError(f"{path}: {key} = {value}: expected a whole number of pixels")
    return int(value)
