"""The map on disk: one safetensors file."""

import dataclasses
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from hsslam_node.config import FieldConfig
from hsslam_node.durable_file import durable_file
from hsslam_node.errors import UserError, did_you_mean
from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.geometry.se3 import are_rigid
from hsslam_node.inertial.gravity import Gravity
from hsslam_node.map.initialisation import initial_parameters
from hsslam_node.map.keyframe_images import KeyframeImages
from hsslam_node.map.layout import FieldLayout
from hsslam_node.rendering.ray_sampling import SamplingPattern

_FILE_OF_RUN = "map.safetensors"  # in the folder of a run
FORMAT = "hsslam-map"
FORMAT_VERSION = 3
P = TypeVar("P")
_READABLE = ("1", "2", "3")  # 1: before bounds could grow; 2: before keyframe images were kept
_CHECKSUM = "crc32"  # of all tensors and the other metadata
_IMAGES = ("color", "color_end", "depth", "depth_end")  # arrays of KeyframeImages


@dataclass(frozen=True)
class MapCheckpoint:
    """A trained map and the keyframes that it was made of."""

    layout: FieldLayout  # configuration and bound
    params: np.ndarray  # [P] float32
    keyframe_stamps_ns: np.ndarray  # [n] int64
    T_world_keyframe: np.ndarray  # [n, 4, 4] float64
    camera: Camera | None = None  # of the keyframes; None in older maps without it
    sampling: SamplingPattern | None = None  # that the map was trained with; None likewise
    images: KeyframeImages | None = None  # of the keyframes, to continue the map; None likewise
    second_moment: np.ndarray | None = None  # [P] float32, Adam's, kept as bfloat16; None likewise
    step: int = 0  # Adam steps that the map has seen
    max_depth_m: float | None = None  # depth beyond was not mapped; None as above
    gravity: Gravity | None = None  # by an IMU; None: not known
    keyframe_gaps: np.ndarray | None = None  # [n, 6, 6] float64, `gap_covariances`; None likewise
    # [4, 4] to the frame `map` of the robot that made it (`level_frame`); None: not known
    T_level_world: np.ndarray | None = None
    # False: keyframes of a fragment; the file has no field, `params` are fresh
    is_fitted: bool = True

    def __post_init__(self) -> None:
        n = len(self.keyframe_stamps_ns)
        _expect("params", self.params, (self.layout.parameter_count,), np.float32)
        _expect("keyframe_stamps_ns", self.keyframe_stamps_ns, (n,), np.int64)
        _expect("T_world_keyframe", self.T_world_keyframe, (n, 4, 4), np.float64)
        if self.T_level_world is not None:
            _expect("T_level_world", self.T_level_world, (4, 4), np.float64)
        if self.keyframe_gaps is not None:
            _expect("keyframe_gaps", self.keyframe_gaps, (n, 6, 6), np.float64)
        if self.images is not None and len(self.images) != n:
            raise ValueError(f"images of {len(self.images)} keyframes, not {n}")
        if self.second_moment is not None:
            _expect("second_moment", self.second_moment, self.params.shape, np.float32)

    def gap_covariance(self, k: int) -> np.ndarray:
        """[6, 6] of the motion to keyframe k from the one before it, as in `KeyframeStore.append`."""
        return np.zeros((6, 6)) if self.keyframe_gaps is None else self.keyframe_gaps[k]


def save_checkpoint(path: Path, checkpoint: MapCheckpoint) -> None:
    """Write the map; the file appears whole or not at all.

    One tensor per block of the field (`field/<block>`), the keyframes with their images, the second
    moments of Adam, and in the metadata format, version, field configuration, bound, camera, sampling
    pattern and a checksum.

    Raises:
        UserError: the file cannot be written.
    """
    tensors: dict[str, np.ndarray] = {}
    if checkpoint.is_fitted:
        blocks = checkpoint.layout.blocks.values()
        tensors |= {f"field/{b.name}": b.view(checkpoint.params).copy() for b in blocks}
    tensors["keyframes/stamps_ns"] = np.ascontiguousarray(checkpoint.keyframe_stamps_ns)
    tensors["keyframes/T_world_keyframe"] = np.ascontiguousarray(checkpoint.T_world_keyframe)
    if checkpoint.keyframe_gaps is not None:
        tensors["keyframes/gaps"] = np.ascontiguousarray(checkpoint.keyframe_gaps)
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
    metadata |= {"step": str(checkpoint.step), "max_depth_m": json.dumps(checkpoint.max_depth_m)}
    if checkpoint.gravity is not None:
        metadata["gravity"] = json.dumps(dataclasses.asdict(checkpoint.gravity))
    if checkpoint.T_level_world is not None:
        metadata["T_level_world"] = json.dumps(checkpoint.T_level_world.tolist())
    if not checkpoint.is_fitted:
        metadata["is_fitted"] = "false"
    elif checkpoint.second_moment is not None:
        tensors["adam/second_moment"] = _to_bfloat16(checkpoint.second_moment)
    if (images := checkpoint.images) is not None:
        tensors |= {f"keyframes/{name}": getattr(images, name) for name in _IMAGES}
        metadata["depth_units_per_m"] = json.dumps(images.depth_units_per_m)
    metadata[_CHECKSUM] = _checksum(tensors, metadata)
    try:
        with durable_file(path) as partial:
            save_file(tensors, partial, metadata)
            _order_metadata(partial)
    except (OSError, SafetensorError) as error:
        raise UserError(f"{path}: cannot write the map: {error}") from None


def _order_metadata(path: Path) -> None:
    """Sort the metadata of a safetensors file, in place: the library writes them in a random order, and the
    same map would not be the same file."""
    with path.open("r+b") as stream:
        length = int.from_bytes(stream.read(8), "little")
        header = json.loads(stream.read(length))
        header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
        text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
        if (
            len(text) <= length
        ):  # a longer one would overwrite tensors; the order is no reason to lose a map
            stream.seek(8)
            stream.write(text.ljust(length))


def load_checkpoint(path: Path) -> MapCheckpoint:
    """Read a map that `save_checkpoint` wrote; `path`: the file, or the folder of a run.

    Raises:
        UserError: no such file, another format or version, or a damaged file.
    """
    try:
        path = path / _FILE_OF_RUN if path.is_dir() else path
        if not path.is_file():
            raise UserError(
                f"{path}: no such file: expected a map file, or the folder of a run that saved its map"
            )
        if not _looks_like_safetensors(path):
            raise UserError(f"{path}: not a map: expected a file such as map.safetensors of a run")
        with safe_open(path, "numpy") as file:
            metadata = file.metadata() or {}
            _check_format(path, metadata)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if metadata["version"] not in ("1", "2"):
            _expect_checksum(tensors, metadata)
        layout, is_fitted = _layout(path, metadata), metadata.get("is_fitted") != "false"
        moment = tensors.get("adam/second_moment")
        if not is_fitted:
            moment = np.zeros(layout.parameter_count, np.uint16)
        return dataclasses.replace(
            _checkpoint(layout, tensors, is_fitted),
            camera=_part(metadata, "camera", Camera),
            sampling=_part(metadata, "sampling", SamplingPattern),
            images=_images(tensors, metadata),
            second_moment=None if moment is None else _from_bfloat16(moment),
            step=int(metadata.get("step", "0")),
            max_depth_m=_max_depth_m(metadata),
            gravity=_part(metadata, "gravity", Gravity),
            keyframe_gaps=tensors.get("keyframes/gaps"),
            T_level_world=_level_frame(metadata),
        )
    except OSError as error:
        raise UserError(f"{path}: {error.strerror or error}: expected a map to read") from None
    except (SafetensorError, ValueError, KeyError, TypeError, RecursionError) as error:
        text = " ".join(str(error).split())
        raise UserError(f"{path}: damaged map: {text or type(error).__name__}") from None


def _looks_like_safetensors(path: Path) -> bool:
    """Whether a JSON header follows the 8 bytes of its length, as in a safetensors file."""
    with path.open("rb") as stream:
        return stream.read(9)[8:] == b"{"


def _check_format(path: Path, metadata: dict[str, str]) -> None:
    if metadata.get("format") != FORMAT:
        raise UserError(f"{path}: format {metadata.get('format')!r}: expected a {FORMAT} file")
    if metadata.get("version") not in _READABLE:
        raise UserError(
            f"{path}: map version {metadata.get('version')}: expected {_READABLE[0]} to "
            f"{_READABLE[-1]}; "
            "load it with the release that saved it"
        )


def _layout(path: Path, metadata: dict[str, str]) -> FieldLayout:
    values = json.loads(metadata["field"])
    known = [f.name for f in dataclasses.fields(FieldConfig)]
    for name in values:
        if name not in known:
            hint = did_you_mean(name, known)
            raise UserError(f"{path}: field.{name}: expected an option of the field{hint}")
    low, high = json.loads(metadata["bound"])
    first = json.loads(metadata.get("first_bound", "null"))
    try:
        return FieldLayout(
            FieldConfig(**values),
            Bound(tuple(low), tuple(high)),
            Bound(tuple(first[0]), tuple(first[1])) if first else None,
        )
    except UserError as error:
        raise ValueError(str(error)) from None


def _checkpoint(
    layout: FieldLayout, tensors: dict[str, np.ndarray], is_fitted: bool
) -> MapCheckpoint:
    params = _params(layout, tensors) if is_fitted else initial_parameters(layout, 0)
    stamps_ns, T = tensors["keyframes/stamps_ns"], tensors["keyframes/T_world_keyframe"]
    checkpoint = MapCheckpoint(layout, params, stamps_ns, T, is_fitted=is_fitted)
    if not are_rigid(checkpoint.T_world_keyframe):
        raise ValueError("T_world_keyframe has a matrix that is no pose")
    return checkpoint


def _params(layout: FieldLayout, tensors: Mapping[str, np.ndarray]) -> np.ndarray:
    params = np.zeros(layout.parameter_count, np.float32)
    for block in layout.blocks.values():
        tensor = tensors[f"field/{block.name}"]
        _expect(f"field/{block.name}", tensor, block.shape, np.float32)
        block.view(params)[...] = tensor
    return params


def _max_depth_m(metadata: Mapping[str, str]) -> float | None:
    value = json.loads(metadata.get("max_depth_m", "null"))
    if value is not None and not (isinstance(value, int | float) and 0 < value < np.inf):
        raise ValueError(f"max_depth_m = {value!r}, not metres above 0")
    return value


def _part(metadata: dict[str, str], name: str, kind: type[P]) -> P | None:
    """A dataclass in the metadata; None in older maps without it."""
    values = json.loads(metadata.get(name, "null"))
    if values is None:
        return None
    try:
        return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})
    except (UserError, AttributeError) as error:
        raise ValueError(f"{name}: {error}") from None


def _level_frame(metadata: Mapping[str, str]) -> np.ndarray | None:
    rows = json.loads(metadata.get("T_level_world", "null"))
    if rows is None:
        return None
    T = np.array(rows, np.float64)
    if T.shape != (4, 4) or not are_rigid(T[None]):
        raise ValueError("T_level_world is no pose")
    return T


def _images(
    tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]
) -> KeyframeImages | None:
    if "keyframes/color" not in tensors:
        return None
    arrays = {name: tensors[f"keyframes/{name}"] for name in _IMAGES}
    return KeyframeImages(
        **arrays, depth_units_per_m=float(json.loads(metadata["depth_units_per_m"]))
    )


def _checksum(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> str:
    covered = {key: value for key, value in metadata.items() if key != _CHECKSUM}
    crc = zlib.crc32(json.dumps(covered, sort_keys=True).encode())
    for name in sorted(tensors):
        crc = zlib.crc32(np.ascontiguousarray(tensors[name]).data, crc)
    return f"{crc:08x}"


def _expect_checksum(tensors: Mapping[str, np.ndarray], metadata: Mapping[str, str]) -> None:
    if _checksum(tensors, metadata) != metadata[_CHECKSUM]:
        raise ValueError("its checksum is wrong")


def _to_bfloat16(values: np.ndarray) -> np.ndarray:
    """The upper halves of float32, as uint16."""
    return (np.ascontiguousarray(values).view(np.uint32) >> 16).astype(np.uint16)


def _from_bfloat16(halves: np.ndarray) -> np.ndarray:
    return (halves.astype(np.uint32) << 16).view(np.float32)


def _expect(name: str, array: np.ndarray, shape: tuple[int, ...], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(
            f"{name} is {array.dtype}{list(array.shape)}, not {np.dtype(dtype)}{list(shape)}"
        )
