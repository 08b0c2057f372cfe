"""A mesh as a Foxglove SceneUpdate.

A protobuf object per vertex takes seconds for a room (4.5 s for 500 000 vertices, against 0.2 s here),
so the repeated fields are written as bytes: each vertex and colour has a fixed length (protobuf wire
format, doubles are wire type 1). A GLB in a ModelPrimitive is smaller, but viewers draw it worse:
docs/architecture.md, departures.
"""

from collections.abc import Mapping

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive

from hsslam_proto.block_revisions import Block
from hsslam_proto.mesh.codec import Triangles, mesh_arrays
from hsslam_proto.mesh.messages import Mesh

_LENGTH_DELIMITED, _FIXED_64 = 2, 1


def scene_update(mesh: Mesh, frame_id: str, stamp_ns: int) -> bytes:
    """Serialized SceneUpdate that replaces all entities with these triangles."""
    deletion = SceneEntityDeletion(type=SceneEntityDeletion.ALL)
    deletion.timestamp.FromNanoseconds(stamp_ns)
    entity = _entity("mesh", mesh_arrays(mesh), frame_id, stamp_ns)
    return SceneUpdate(deletions=[deletion]).SerializeToString() + entity


def blocks_update(blocks: Mapping[Block, Triangles | None], frame_id: str, stamp_ns: int) -> bytes:
    """Serialized SceneUpdate of these blocks, one entity `mesh/i_j_k` each; None: the entity is deleted."""
    gone = []
    for block in (block for block, triangles in blocks.items() if triangles is None):
        deletion = SceneEntityDeletion(type=SceneEntityDeletion.MATCHING_ID, id=_name(block))
        deletion.timestamp.FromNanoseconds(stamp_ns)
        gone.append(deletion)
    entities = [
        _entity(_name(block), triangles, frame_id, stamp_ns)
        for block, triangles in blocks.items()
        if triangles is not None
    ]
    return SceneUpdate(deletions=gone).SerializeToString() + b"".join(entities)


def _name(block: Block) -> str:
    return "mesh/" + "_".join(map(str, block))


def _entity(name: str, mesh: Triangles, frame_id: str, stamp_ns: int) -> bytes:
    opaque = np.column_stack([mesh.colors / 255.0, np.ones(len(mesh.colors))])
    triangles = (
        _head()
        + _repeated_doubles(_number(TriangleListPrimitive, "points"), mesh.vertices)
        + _repeated_doubles(_number(TriangleListPrimitive, "colors"), opaque)
        + _delimited(_number(TriangleListPrimitive, "indices"), mesh.faces.tobytes())
    )
    entity = SceneEntity(frame_id=frame_id, id=name)
    entity.timestamp.FromNanoseconds(stamp_ns)
    body = entity.SerializeToString() + _delimited(_number(SceneEntity, "triangles"), triangles)
    return _delimited(_number(SceneUpdate, "entities"), body)


def _head() -> bytes:
    """Pose and fallback colour of the triangle list."""
    triangles = TriangleListPrimitive()
    triangles.pose.orientation.w = 1.0
    triangles.color.r = triangles.color.g = triangles.color.b = 0.7
    triangles.color.a = 1.0
    return triangles.SerializeToString()


def _repeated_doubles(field: int, rows: np.ndarray) -> bytes:
    """A repeated sub-message of D doubles (its fields 1 to D) for each row of [N, D]."""
    width = rows.shape[1]
    layout = [("tag", "u1"), ("length", "u1")]
    for k in range(width):
        layout += [(f"tag_{k}", "u1"), (f"value_{k}", "<f8")]
    out = np.empty(len(rows), np.dtype(layout))
    out["tag"] = _tag(field, _LENGTH_DELIMITED)
    out["length"] = 9 * width
    for k in range(width):
        out[f"tag_{k}"] = _tag(k + 1, _FIXED_64)
        out[f"value_{k}"] = rows[:, k]
    return out.tobytes()


def _delimited(field: int, body: bytes) -> bytes:
    return bytes([_tag(field, _LENGTH_DELIMITED)]) + _varint(len(body)) + body


def _tag(field: int, wire_type: int) -> int:
    return field << 3 | wire_type


def _number(message: type, field: str) -> int:
    return message.DESCRIPTOR.fields_by_name[field].number  # type: ignore[attr-defined]


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
