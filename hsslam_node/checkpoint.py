"""The map on disk: everything needed to load it again, in one safetensors file."""

import dataclasses
import difflib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from hsslam_node.config import FieldConfig
from hsslam_node.errors import UserError
from hsslam_node.field.layout import FieldLayout
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.rendering.ray_sampling import SamplingPattern

FORMAT = "hsslam-map"
FORMAT_VERSION = 2
P = TypeVar("P")
_READABLE = ("1", "2")  # 1: before bounds could grow


@dataclass(frozen=True)
class MapCheckpoint:
    """A trained map and the keyframes that it was made of."""

    layout: FieldLayout  # configuration and bound
    params: np.ndarray  # [P] float32
    keyframe_stamps_ns: np.ndarray  # [n] int64
    T_world_keyframe: np.ndarray  # [n, 4, 4] float64
    camera: Camera | None = None  # of the keyframes; None in maps of before it was kept
    sampling: SamplingPattern | None = None  # that the map was trained with; None likewise

    def __post_init__(self) -> None:
        n = len(self.keyframe_stamps_ns)
        _expect("params", self.params, (self.layout.parameter_count,), np.float32)
        _expect("keyframe_stamps_ns", self.keyframe_stamps_ns, (n,), np.int64)
        _expect("T_world_keyframe", self.T_world_keyframe, (n, 4, 4), np.float64)


def save_checkpoint(path: Path, checkpoint: MapCheckpoint) -> None:
    """Write the map; the file appears whole or not at all.

    One tensor per block of the field (`field/<block>`), the keyframes, and in the metadata format,
    version, field configuration, bound, camera and sampling pattern.

    Raises:
        UserError: the file cannot be written.
    """
    blocks = checkpoint.layout.blocks.values()
    tensors = {f"field/{b.name}": b.view(checkpoint.params).copy() for b in blocks}
    tensors["keyframes/stamps_ns"] = np.ascontiguousarray(checkpoint.keyframe_stamps_ns)
    tensors["keyframes/T_world_keyframe"] = np.ascontiguousarray(checkpoint.T_world_keyframe)
    bound, first = checkpoint.layout.bound, checkpoint.layout.first_bound
    metadata = {
        "format": FORMAT,
        "version": str(FORMAT_VERSION),
        "field": json.dumps(dataclasses.asdict(checkpoint.layout.config)),
        "bound": json.dumps([bound.low, bound.high]),
        "first_bound": json.dumps([first.low, first.high]) if first else "null",
    }
    for name, part in (("camera", checkpoint.camera), ("sampling", checkpoint.sampling)):
        metadata[name] = json.dumps(dataclasses.asdict(part)) if part else "null"
    partial = path.with_name(f"{path.name}.partial")
    try:
        save_file(tensors, partial, metadata)
        partial.replace(path)
    except (OSError, SafetensorError) as error:
        partial.unlink(missing_ok=True)
        raise UserError(f"{path}: cannot write the map: {error}") from None


def load_checkpoint(path: Path) -> MapCheckpoint:
    """Read a map that `save_checkpoint` wrote.

    Raises:
        UserError: no such file, another format or version, or a damaged file.
    """
    if not path.is_file():
        raise UserError(f"{path}: no such file: expected a map that a run has saved")
    try:
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            _check_format(path, metadata)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        layout = _layout(path, metadata)
        return dataclasses.replace(
            _checkpoint(layout, tensors),
            camera=_part(metadata, "camera", Camera),
            sampling=_part(metadata, "sampling", SamplingPattern),
        )
    except (SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        text = " ".join(str(error).split())
        raise UserError(f"{path}: damaged map: {text or type(error).__name__}") from None


def _check_format(path: Path, metadata: dict[str, str]) -> None:
    if metadata.get("format") != FORMAT:
        raise UserError(f"{path}: format {metadata.get('format')!r}: expected a {FORMAT} file")
    if metadata.get("version") not in _READABLE:
        raise UserError(
            f"{path}: map version {metadata.get('version')}: expected {' or '.join(_READABLE)}; "
            "load it with the release that saved it"
        )


def _layout(path: Path, metadata: dict[str, str]) -> FieldLayout:
    values = json.loads(metadata["field"])
    known = [f.name for f in dataclasses.fields(FieldConfig)]
    for name in values:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"; did you mean {near[0]}?" if near else ""
            raise UserError(f"{path}: field.{name}: expected an option of the field{hint}")
    low, high = json.loads(metadata["bound"])
    first = json.loads(metadata.get("first_bound", "null"))
    return FieldLayout(
        FieldConfig(**values),
        Bound(tuple(low), tuple(high)),
        Bound(tuple(first[0]), tuple(first[1])) if first else None,
    )


def _checkpoint(layout: FieldLayout, tensors: dict[str, np.ndarray]) -> MapCheckpoint:
    params = np.zeros(layout.parameter_count, np.float32)
    for block in layout.blocks.values():
        tensor = tensors[f"field/{block.name}"]
        _expect(f"field/{block.name}", tensor, block.shape, np.float32)
        block.view(params)[...] = tensor
    return MapCheckpoint(
        layout, params, tensors["keyframes/stamps_ns"], tensors["keyframes/T_world_keyframe"]
    )


def _part(metadata: dict[str, str], name: str, kind: type[P]) -> P | None:
    """A dataclass in the metadata; None in maps of before it was kept."""
    values = json.loads(metadata.get(name, "null"))
    if values is None:
        return None
    try:
        return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})
    except (UserError, AttributeError) as error:
        raise ValueError(f"{name}: {error}") from None


def _expect(name: str, array: np.ndarray, shape: tuple[int, ...], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(
            f"{name} is {array.dtype}{list(array.shape)}, not {np.dtype(dtype)}{list(shape)}"
        )
