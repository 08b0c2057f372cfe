"""Copies the parameters over one bound to their places over a larger bound."""

import numpy as np

from hsslam_node.map.layout import PLANE_AXES, FieldLayout

_AXES_OF: dict[str, tuple[int, int]] = dict(zip(("xy", "xz", "yz"), PLANE_AXES, strict=True))


def copy_grown(old: FieldLayout, source: np.ndarray, new: FieldLayout, target: np.ndarray) -> None:
    """Write parameters or moments `source` [P_old] over the bound of `old` into `target` [P_new].

    `new` is `old.grown(...)`. Every vertex of the old bound is overwritten; new vertices keep their values
    in `target`. Vertices keep their place in the world and the hashed levels their entries, so the field
    does not change within the old bound.
    """
    for name, block in old.blocks.items():
        there = new.blocks[name].view(target)
        there[_place(old, new, name)] = block.view(source)


def _place(old: FieldLayout, new: FieldLayout, name: str) -> tuple[slice, ...] | slice | np.ndarray:
    """Index of the entries of an old block in the first axes of the new one."""
    kind, _, part = name.partition(".")
    if kind in ("geometry_coarse", "geometry_fine", "appearance_coarse", "appearance_fine"):
        cell_m = _cell_m(old, kind)
        first, count = old.plane_vertices(cell_m)
        at = first - new.plane_vertices(cell_m)[0]
        u, v = _AXES_OF[part]
        return slice(at[v], at[v] + count[v]), slice(at[u], at[u] + count[u])
    if kind == "hash" and old.hash_is_dense[int(part)]:
        first, count = old.hash_vertices(int(part))
        new_first, new_count = new.hash_vertices(int(part))
        x, y, z = (np.arange(n) + s for n, s in zip(count, first - new_first, strict=True))
        rows = z[:, None] * new_count[1] + y  # [n_z, n_y]
        return (rows[..., None] * new_count[0] + x).ravel()
    return slice(None)


def _cell_m(layout: FieldLayout, kind: str) -> float:
    if kind.endswith("coarse"):
        return layout.config.coarse_cell_m
    if kind == "geometry_fine":
        return layout.config.geometry_fine_cell_m
    return layout.config.appearance_fine_cell_m
