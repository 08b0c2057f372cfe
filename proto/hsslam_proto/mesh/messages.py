"""Messages of meshes: a whole mesh, and blocks of the live mesh that have changed."""

import numpy as np

from hsslam_proto.message import Index, Message, Real, expect_bytes


class Mesh(Message, frozen=True, kw_only=True):
    """Triangles: vertices [V, 3] float32 m world, faces [F, 3] uint32, colors [V, 3] uint8 RGB."""

    map_version: Index
    vertex_count: Index
    face_count: Index
    vertices: memoryview
    faces: memoryview
    colors: memoryview
    final: bool = False
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        counts = {"vertices": 12 * self.vertex_count, "faces": 12 * self.face_count}
        counts["colors"] = 3 * self.vertex_count
        for name, nbytes in counts.items():
            expect_bytes(self, name, nbytes)
        if self.face_count and np.frombuffer(self.faces, "<u4").max() >= self.vertex_count:
            raise ValueError(f"faces: expected vertex numbers below {self.vertex_count}")
        if not np.isfinite(np.frombuffer(self.vertices, "<f4")).all():
            raise ValueError("vertices: expected finite numbers")


class MeshBlocks(Message, frozen=True, kw_only=True):
    """Blocks of the live mesh: cubes of `block_m` at integer places, each with its own vertices and faces.

    `blocks` [B, 3] int32: block b covers b * block_m to (b + 1) * block_m, m world. `vertex_counts` and
    `face_counts` [B] uint32: counts of each block; 0: the block has no surface any more. `vertices` [V, 3]
    float32 m world, `faces` [F, 3] uint32, vertex numbers within their block, and `colors` [V, 3] uint8 RGB
    list all blocks one after the other. A block replaces its earlier `revision`. `series` grows when a mesher
    starts: blocks of an earlier series are gone. `voxel_m`: side of the lattice's cells, m; vertices lie on
    their edges. The answer to a `get` on the key is all current blocks, in one or more messages.
    """

    series: Index
    revision: Index
    map_version: Index
    voxel_m: Real
    block_m: Real
    blocks: memoryview
    vertex_counts: memoryview
    face_counts: memoryview
    vertices: memoryview
    faces: memoryview
    colors: memoryview
    map_epoch: Index = 0

    def __post_init__(self) -> None:
        for name in ("voxel_m", "block_m"):
            if not 0 < getattr(self, name) < 1e6:
                raise ValueError(f"{name} = {getattr(self, name)}: expected metres above 0")
        expect_bytes(self, "blocks", 12 * (memoryview(self.vertex_counts).nbytes // 4))
        expect_bytes(self, "vertex_counts", 4 * (memoryview(self.blocks).nbytes // 12))
        expect_bytes(self, "face_counts", 4 * (memoryview(self.blocks).nbytes // 12))
        vertex_counts = np.frombuffer(self.vertex_counts, "<u4").astype(np.int64)
        face_counts = np.frombuffer(self.face_counts, "<u4").astype(np.int64)
        expect_bytes(self, "vertices", 12 * int(vertex_counts.sum()))
        expect_bytes(self, "colors", 3 * int(vertex_counts.sum()))
        expect_bytes(self, "faces", 12 * int(face_counts.sum()))
        faces = np.frombuffer(self.faces, "<u4").reshape(-1, 3)
        if (faces >= np.repeat(vertex_counts, face_counts)[:, None]).any():
            raise ValueError("faces: expected vertex numbers below the count of their block")
        if not np.isfinite(np.frombuffer(self.vertices, "<f4")).all():
            raise ValueError("vertices: expected finite numbers")
