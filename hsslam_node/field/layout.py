"""Where every block of the scene model lies in the flat parameter array."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hsslam_node.config import FieldConfig
from hsslam_node.geometry.bound import Bound

ALIGNMENT = 16  # floats; one cache line, and the chunk that Adam steps
PLANE_AXES = ((0, 1), (0, 2), (1, 2))  # (u, v) world axes of the xy, xz and yz planes


@dataclass(frozen=True)
class Block:
    """One named array inside the flat parameters: `params[offset : offset + size].reshape(shape)`."""

    name: str
    offset: int
    shape: tuple[int, ...]

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def view(self, params: np.ndarray) -> np.ndarray:
        """The block as a view of the flat array [P]."""
        return params[self.offset : self.offset + self.size].reshape(self.shape)


@dataclass(frozen=True)
class FieldLayout:
    """The blocks of a scene model over a bound; geometry first, so a tracker can copy a prefix.

    An encoding that is switched off has planes without channels, no hash levels, or no one-blob rows.

    Order: geometry planes (coarse xy xz yz, fine xy xz yz), hash tables, decoders, log_beta,
    appearance planes (coarse, fine). Planes are [n_v, n_u, C], vertex (0, 0) at the low corner.
    `bound` must be snapped to the coarse cell (`FieldLayout.over` does it).
    """

    config: FieldConfig
    bound: Bound

    @classmethod
    def over(cls, config: FieldConfig, bound: Bound) -> "FieldLayout":
        """Layout over the bound, its sides rounded up to whole coarse cells."""
        return cls(config, bound.snapped(config.coarse_cell_m))

    def plane_resolution(self, cell_m: float) -> tuple[int, int, int]:
        """Vertices along x, y, z of planes with this cell."""
        n = np.round(self.bound.extent_m / cell_m).astype(int) + 1
        return int(n[0]), int(n[1]), int(n[2])

    @cached_property
    def hash_resolutions(self) -> tuple[int, ...]:
        """Cells per longest side of the bound, for each hash table (Co-SLAM's growth rule by level)."""
        c = self.config
        finest = max(
            float(self.bound.extent_m.max()) / c.hash_finest_cell_m, c.hash_base_resolution
        )
        growth = math.exp(math.log(finest / c.hash_base_resolution) / max(c.hash_levels - 1, 1))
        levels = [
            math.floor(c.hash_base_resolution * growth**level + 1e-6)
            for level in range(c.hash_levels)
        ]
        return tuple(
            levels[table * c.hash_levels // c.hash_tables] for table in range(c.hash_tables)
        )

    @cached_property
    def hash_entries(self) -> tuple[int, ...]:
        """Entries of each table: (res + 1)^3 where that fits 2^table_log2 (dense), else the table."""
        table = 1 << self.config.hash_table_log2
        return tuple(min((res + 1) ** 3, table) for res in self.hash_resolutions)

    @cached_property
    def hash_is_dense(self) -> tuple[bool, ...]:
        """Whether a table is indexed densely, x + (res+1) y + (res+1)^2 z, or by the XOR hash."""
        table = 1 << self.config.hash_table_log2
        return tuple((res + 1) ** 3 <= table for res in self.hash_resolutions)

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """All blocks by name, in memory order."""
        c = self.config
        shapes: list[tuple[str, tuple[int, ...]]] = []

        def add_planes(prefix: str, cell_m: float) -> None:
            n = self.plane_resolution(cell_m)
            for (u, v), axes in zip(PLANE_AXES, ("xy", "xz", "yz"), strict=True):
                shapes.append((f"{prefix}.{axes}", (n[v], n[u], c.plane_channels)))

        add_planes("geometry_coarse", c.coarse_cell_m)
        add_planes("geometry_fine", c.geometry_fine_cell_m)
        for table, entries in enumerate(self.hash_entries):
            shapes.append((f"hash.{table:02d}", (entries, 2)))
        shapes.append(("geometry_decoder.W1", (c.geometry_input_width, c.hidden_width)))
        shapes.append(("geometry_decoder.W2", (c.hidden_width, 1 + c.geometry_feature_width)))
        shapes.append(("color_decoder.W1", (c.color_input_width, c.hidden_width)))
        shapes.append(("color_decoder.W2", (c.hidden_width, 3)))
        shapes.append(("log_beta", (1,)))
        add_planes("appearance_coarse", c.coarse_cell_m)
        add_planes("appearance_fine", c.appearance_fine_cell_m)

        blocks, offset = {}, 0
        for name, shape in shapes:
            blocks[name] = Block(name, offset, shape)
            offset += -(-math.prod(shape) // ALIGNMENT) * ALIGNMENT
        return blocks

    @cached_property
    def parameter_count(self) -> int:
        """Length P of the flat array, padding included."""
        last = list(self.blocks.values())[-1]
        return last.offset + -(-last.size // ALIGNMENT) * ALIGNMENT

    @cached_property
    def hash_first(self) -> int:
        """Where the hash levels begin; without any, where the decoders do."""
        first = self.blocks.get("hash.00", self.blocks["geometry_decoder.W1"])
        return first.offset

    @cached_property
    def geometry_count(self) -> int:
        """Length of the prefix that answers SDF queries (planes, hash, decoders, log_beta)."""
        return self.blocks["appearance_coarse.xy"].offset

    def size_bytes_by_part(self) -> dict[str, int]:
        """Model size per part (float32), for the summary."""
        sizes: dict[str, int] = {}
        for block in self.blocks.values():
            if block.size == 0:
                continue
            part = block.name.split(".")[0]
            sizes[part] = sizes.get(part, 0) + 4 * block.size
        return sizes
