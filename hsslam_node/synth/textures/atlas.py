"""All faces of the scene, textured and lit, as one array of mip levels."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from hsslam_node.synth.parts.primitive import HIDDEN, Kind, Primitive
from hsslam_node.synth.scenes.scene import Scene, Zone, scene_arrays
from hsslam_node.synth.textures.lighting import bake_light, light_samples
from hsslam_node.synth.textures.textures import blurred, make_texture

_TEXEL_M = 0.004
_FINE_TEXEL_M = 0.0025  # books, pictures and other small things
_FINE_AREA_M2 = 0.4
_SEEN_FROM_M = 1.1  # the camera stays above: undersides below this height need no texture
_LIGHT_TEXEL_M = 0.05
_AMBIENT_RAYS = 20
_UNLIT = ("window", "screen", "glow", HIDDEN)


@dataclass(frozen=True)
class Atlas:
    """What the ray caster reads: texels of all levels of all faces, and tables to find them."""

    first_faces: np.ndarray  # [P] int32, number of a primitive's first face
    first_levels: np.ndarray  # [F] int32, row of `levels` of a face's finest level
    inverse_texels: np.ndarray  # [F] float32, texels of the finest level per metre
    levels: np.ndarray  # [N, 3] int32: offset into `texels`, width, height
    texels: np.ndarray  # [M] uint32 0x00BBGGRR


def build_atlas(scene: Scene, seed: int, coarseness: float = 1.0) -> Atlas:
    """Textures and bakes every face of the primitives; the same seed gives the same bytes.

    `coarseness` scales the texels: 1 is right for images 640 pixels wide, 2 for 320.
    """
    first_faces, first_levels, inverse_texels, images = [], [], [], []
    for number, (part, light) in enumerate(_lit_parts(scene, seed)):
        first_faces.append(len(first_levels))
        for face in range(part.face_count):
            rng = np.random.default_rng((seed, 3, number, face))
            image, texel_m = _albedo(part, face, rng, seed, coarseness * scene.coarseness)
            if not part.material(face).startswith(_UNLIT):
                image *= light(part, face, image.shape[:2])[..., None]
            first_levels.append(len(images))
            inverse_texels.append(1 / texel_m)
            images += pyramid(_encode(image))
    levels, texels = lay_out(images)
    return Atlas(
        np.array(first_faces, np.int32),
        np.array(first_levels, np.int32),
        np.array(inverse_texels, np.float32),
        levels,
        texels,
    )


def pyramid(image: np.ndarray) -> list[np.ndarray]:
    """The image [h, w, 3] and its halves down to one texel, which repeats so that look-ups stay inside."""
    levels = [image]
    while max(levels[-1].shape[:2]) > 1:
        h, w = levels[-1].shape[:2]
        levels.append(
            cv2.resize(levels[-1], ((w + 1) // 2, (h + 1) // 2), interpolation=cv2.INTER_AREA)
        )
    return levels + [levels[-1]] * 6


def lay_out(images: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """`levels` and `texels` of an atlas of these images [h, w, 3] uint8."""
    levels, blocks, offset = [], [], 0
    for image in images:
        levels.append((offset, image.shape[1], image.shape[0]))
        blocks.append(_packed(image))
        offset += image.shape[0] * image.shape[1]
    return np.array(levels, np.int32), np.concatenate(blocks)


def _lit_parts(scene: Scene, seed: int) -> Iterator[tuple[Primitive, "_Light"]]:
    """Every part of the scene, in order, and the light of its zone."""
    lights = [_Light(scene, zone, seed) for zone in scene.zones]
    yield scene.shell, lights[0]
    for zone, light in zip(scene.zones, lights, strict=True):
        for part in zone.parts:
            yield part, light
    for part in scene.parts_at(0)[len(scene.still_parts) :]:
        yield part, lights[0]


def _albedo(
    part: Primitive,
    face: int,
    rng: np.random.Generator,
    seed: int,
    coarseness: float,
) -> tuple[np.ndarray, float]:
    width_m, height_m = part.face_size_m(face)
    if _is_hidden(part, face):
        return np.full((2, 2, 3), 0.3, np.float32), max(width_m, height_m) / 2
    texel_m = coarseness * (_FINE_TEXEL_M if width_m * height_m < _FINE_AREA_M2 else _TEXEL_M)
    w, h = max(2, round(width_m / texel_m)), max(2, round(height_m / texel_m))
    material = part.material(face)
    if part.kind in (Kind.CYLINDER, Kind.ELLIPSOID) and face == 0:
        half = make_texture(material, (h, (w + 1) // 2), texel_m, rng)
        image = np.concatenate([half, half[:, ::-1]], axis=1)[:, :w]  # meets itself at the back
    else:
        if material == "book":  # all faces of one book share their colour
            shade = np.random.default_rng((seed, zlib.crc32(part.center_m.tobytes())))
            rng = shade
        image = make_texture(material, (h, w), texel_m, rng)
    return blurred(image, 0.6), texel_m


def _is_hidden(part: Primitive, face: int) -> bool:
    if part.material(face) == HIDDEN:
        return True
    underside = {Kind.BOX: 5, Kind.CYLINDER: 2}.get(part.kind)
    bottom_m = part.center_m[2] - part.half_m[2]
    return face == underside and part.rotation[2, 2] > 0.999 and bottom_m < _SEEN_FROM_M


class _Light:
    """Light in one zone."""

    def __init__(self, scene: Scene, zone: Zone, seed: int) -> None:
        self._arrays = scene_arrays([scene.shell, *zone.parts])
        self._texel_m = _LIGHT_TEXEL_M * scene.coarseness
        self._lamps = light_samples(zone.lamps_m, seed)
        self._directions = _cosine_directions(_AMBIENT_RAYS)

    def __call__(self, part: Primitive, face: int, shape: tuple[int, int]) -> np.ndarray:
        """Irradiance [h, w] float32 of a face, baked coarsely and interpolated."""
        width_m, height_m = part.face_size_m(face)
        w, h = max(3, round(width_m / self._texel_m)), max(3, round(height_m / self._texel_m))
        u, v = np.meshgrid((np.arange(w) + 0.5) / w, (np.arange(h) + 0.5) / h)
        points, normals = part.surface(face, u, v)
        a = self._arrays
        light = bake_light(
            a["kinds"], a["rotations"], a["centers"], a["halves"],
            np.ascontiguousarray(points.reshape(-1, 3)), np.ascontiguousarray(normals.reshape(-1, 3)),
            self._lamps, self._directions,
        ).reshape(h, w)  # fmt: skip
        light = cv2.GaussianBlur(light, (3, 3), 0.8)
        return cv2.resize(light, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)


def _cosine_directions(count: int) -> np.ndarray:
    """Cosine-weighted directions about +z, [count, 3], on a golden spiral."""
    k = np.arange(count) + 0.5
    r, a = np.sqrt(k / count), 2.399963 * k
    return np.column_stack([r * np.cos(a), r * np.sin(a), np.sqrt(1 - k / count)])


def _encode(image: np.ndarray) -> np.ndarray:
    """Linear light to 8 bit with a camera's soft shoulder and gamma."""
    exposed = 1.15 * image
    return np.clip(255 * (exposed / (1 + 0.18 * exposed)) ** (1 / 1.5), 0, 255).astype(np.uint8)


def _packed(image: np.ndarray) -> np.ndarray:
    channels = np.zeros((*image.shape[:2], 4), np.uint8)
    channels[..., :3] = image
    return channels.view(np.uint32).ravel()
