"""Reads `camera.json` (TUM layout, plain folders) and `cam_params.json` (Replica layout)."""

import json
from collections.abc import Collection
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta

from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.geometry.camera import Camera, LensModel, expect_lens

_MOST = 1e9  # keeps infinity out
_Size = Annotated[
    float, Meta(gt=0, le=1e6, multiple_of=1, description="a whole number of pixels above 0")
]
_Positive = Annotated[float, Meta(gt=0, le=_MOST, description="a number above 0")]
_Number = Annotated[float, Meta(ge=-_MOST, le=_MOST, description="a finite number")]
_Numbers = Annotated[list[_Number], Meta(description="a list of finite numbers")]
_Model = Annotated[LensModel, Meta(description="opencv or equidistant")]


class _CameraFile(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    width: _Size
    height: _Size
    fx: _Positive
    fy: _Positive
    cx: _Number
    cy: _Number
    distortion: _Numbers = msgspec.field(default_factory=list)
    distortion_model: _Model = "opencv"
    depth_scale: _Positive = 5000.0


class _ReplicaCamera(msgspec.Struct):
    w: _Size
    h: _Size
    fx: _Positive
    fy: _Positive
    cx: _Number
    cy: _Number
    scale: _Positive


_File = TypeVar("_File", _CameraFile, _ReplicaCamera)


def read_tum_camera(path: Path) -> tuple[Camera, float]:
    """Camera (with its distortion) and depth units per metre of a `camera.json`.

    Keys: width, height, fx, fy, cx, cy in pixels; distortion (OpenCV's 4, 5, 8, 12 or 14 coefficients,
    default none); distortion_model (opencv, or equidistant with 4 coefficients); depth_scale (PNG units
    per metre, default 5000).

    Raises:
        UserError: the file cannot be read, or a field is missing, unknown or has a wrong value.
    """
    return _tum_camera(path, _read_object(path))


def read_record_camera(
    path: Path, given: dict[str, object], size: tuple[int, int]
) -> tuple[Camera, float]:
    """The same for a plain folder of images (width, height in pixels), whose `camera.json` may be missing.

    `given`: values of options, which override the file. Default of fy is fx; default of cx, cy is the middle
    of the image.

    Raises:
        UserError: as `read_tum_camera`, naming the options of `given`; fx or depth_scale is missing;
            the file is for another size.
    """
    fields = (_read_object(path) if path.exists() else {}) | given
    missing = [key for key in ("fx", "depth_scale") if key not in fields]
    if missing:
        verb = "are" if len(missing) > 1 else "is"
        options = ", ".join(map(_option, missing))
        raise UserError(
            f"{path.parent}: {' and '.join(missing)} {verb} missing: expected in {path.name} (with fy, cx, "
            f"cy) or as {options}"
        )
    width, height = size
    middle = {"cx": (width - 1) / 2, "cy": (height - 1) / 2}
    sized = {"width": width, "height": height, "fy": fields["fx"]} | middle | fields
    camera, scale = _tum_camera(path, sized, given)
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
        UserError: the file cannot be read, or a field is missing or has a wrong value.
    """
    fields = _read_object(path).get("camera")
    if not isinstance(fields, dict):
        raise UserError(f"{path}: field 'camera' is missing: expected w, h, fx, fy, cx, cy, scale")
    file = _checked(path, fields, _ReplicaCamera)
    return Camera(int(file.w), int(file.h), file.fx, file.fy, file.cx, file.cy), file.scale


def _tum_camera(
    path: Path, fields: dict[str, Any], given: Collection[str] = ()
) -> tuple[Camera, float]:
    """`given`: fields that are options, and not of the file."""
    file = _checked(path, fields, _CameraFile, given)
    where = str(path)
    if "distortion_model" in given:
        where = f"{_option('distortion_model')} {file.distortion_model}"
    expect_lens(f"{where}: distortion", file.distortion, file.distortion_model)
    size = (int(file.width), int(file.height))
    lens = (tuple(file.distortion), file.distortion_model)
    camera = Camera(*size, file.fx, file.fy, file.cx, file.cy, *lens)
    return camera if camera.has_lens else camera.undistorted(), file.depth_scale


def _read_object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}): expected the camera") from None
    except ValueError as error:
        raise UserError(f"{path}: not JSON ({error}): expected the camera") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: holds a {type(content).__name__}: expected a JSON object")
    return content


def _option(field: str) -> str:
    return f"--camera.{field.replace('_', '-')}"


def _checked(
    path: Path, fields: dict[str, Any], kind: type[_File], given: Collection[str] = ()
) -> _File:
    try:
        return msgspec.convert(fields, kind)
    except msgspec.ValidationError as error:
        raise UserError(_fault(path, fields, kind, given) or f"{path}: {error}") from None


def _fault(
    path: Path, fields: dict[str, Any], kind: type[msgspec.Struct], given: Collection[str]
) -> str:
    """The first field that does not fit, where it comes from, its value and what is expected."""
    known = {field.name: field for field in msgspec.structs.fields(kind)}
    for name in fields:
        if name not in known and kind.__struct_config__.forbid_unknown_fields:
            every = ", ".join(known)
            return f"{path}: unknown field {name!r}: expected {every}{did_you_mean(name, known)}"
    for name, field in known.items():
        expected = field.type.__metadata__[0].description
        if name not in fields:
            if field.required:
                return f"{path}: field {name!r} is missing: expected {expected}"
            continue
        try:
            msgspec.convert(fields[name], field.type)
        except msgspec.ValidationError:
            place = f"{_option(name)} = " if name in given else f"{path}: {name} = "
            return f"{place}{fields[name]}: expected {expected}"
    return ""
