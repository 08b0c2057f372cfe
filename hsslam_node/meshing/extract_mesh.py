"""Extracts the mesh of the surface that cameras observed, or of the whole map, in one call."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import trimesh

from hsslam_node.geometry.bound import Bound
from hsslam_node.geometry.camera import Camera
from hsslam_node.meshing.block_mesh import BlockMesh
from hsslam_node.meshing.block_surface import Block, QueryColor, QuerySdf, block_surface
from hsslam_node.meshing.faces_seen import faces_seen
from hsslam_node.meshing.observed_space import ObservedSpace
from hsslam_node.meshing.weld import kept_faces, weld_blocks
from hsslam_node.meshing.whole_space import WholeSpace


def extract_mesh(
    query_sdf: QuerySdf,
    query_color: QueryColor,
    bound: Bound,
    camera: Camera,
    keyframes: Sequence[tuple[np.ndarray, np.ndarray]],
    voxel_m: float = 0.03,
    stride_px: int = 1,
    min_component_faces: int = 50,
    max_depth_m: float = math.inf,
    threads: int = 1,
) -> trimesh.Trimesh:
    """Coloured triangle mesh of the observed surface, metres, world; normals into free space.

    It leaves out triangles whose front no keyframe saw, and those of objects that were removed.

    Args:
        query_sdf: signed distances of points.
        query_color: colours of points.
        bound: space to mesh.
        camera: of all keyframes, undistorted.
        keyframes: depth [H, W] float32 m and T_world_cam [4, 4] of each; read twice.
        voxel_m: cell of marching cubes, m.
        stride_px: step between the depth pixels that mark observed space.
        min_component_faces: smaller connected pieces are left out.
        max_depth_m: depth beyond this marks no surface, but still shows that the way to it is free.
        threads: that query the map and the keyframes in parallel; the mesh does not depend on it.
    """
    space = ObservedSpace(bound, voxel_m)

    def observe(k: int) -> None:
        depth_m, T_world_cam = keyframes[k]
        near_m = np.where(depth_m <= max_depth_m, depth_m, 0)
        space.observe(near_m, camera, T_world_cam, stride_px)

    def surface(block: Block) -> BlockMesh | None:
        return block_surface(space, block, query_sdf, query_color)[0]

    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(observe, range(len(keyframes))):
            pass
        blocks = [mesh for mesh in pool.map(surface, space.occupied_blocks()) if mesh]
        mesh = weld_blocks(blocks, space, min_component_faces)
        if len(mesh.faces) == 0:
            return mesh
        vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        seen = faces_seen(vertices, faces, camera, keyframes, pool)
    return kept_faces(mesh, seen, min_component_faces)


def extract_whole_mesh(
    query_sdf: QuerySdf,
    query_color: QueryColor,
    bound: Bound,
    voxel_m: float,
    threads: int = 1,
) -> trimesh.Trimesh:
    """Coloured triangle mesh of every surface in the bound, seen or not; arguments as in `extract_mesh`.

    It queries every voxel. Surface without measurements is a guess: for evaluations, which cull meshes.
    """
    space = WholeSpace(bound, voxel_m)

    def surface(block: Block) -> BlockMesh | None:
        return block_surface(space, block, query_sdf, query_color)[0]

    with ThreadPoolExecutor(threads) as pool:
        blocks = [mesh for mesh in pool.map(surface, space.blocks()) if mesh]
    return weld_blocks(blocks, space, 1)
