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

    Vertices of planes and hash levels are numbered from the low corner of the *first* bound. Its longest
    side also sets the cells of the hash levels, and its sides normalise one-blob. None of this changes when
    the bound grows, so parameters keep their place and their meaning.
    """

    config: FieldConfig
    bound: Bound
    first_bound: Bound | None = None  # None: the bound has not grown

    @classmethod
    def over(cls, config: FieldConfig, bound: Bound) -> "FieldLayout":
        """Layout over the bound, its sides rounded up to whole coarse cells."""
        return cls(config, bound.snapped(config.coarse_cell_m))

    def grown(self, bound: Bound) -> "FieldLayout":
        """The layout over this bound and `bound`, in whole coarse cells of the same lattice."""
        cell, origin = self.config.coarse_cell_m, np.asarray(self.lattice.low)
        below = np.floor((np.minimum(bound.low, self.bound.low) - origin) / cell + 1e-6)
        above = np.ceil((np.maximum(bound.high, self.bound.high) - origin) / cell - 1e-6)
        whole = Bound.of(origin + below * cell, origin + above * cell)
        return FieldLayout(self.config, whole, self.lattice)

    @property
    def lattice(self) -> Bound:
        """The first bound: its low corner is vertex 0 of all planes and hash levels."""
        return self.first_bound or self.bound

    def plane_vertices(self, cell_m: float) -> tuple[np.ndarray, np.ndarray]:
        """First vertex and number of vertices along x, y, z of planes with this cell, [3] each."""
        first = np.round(np.subtract(self.bound.low, self.lattice.low) / cell_m).astype(int)
        last = np.round(np.subtract(self.bound.high, self.lattice.low) / cell_m).astype(int)
        return first, last - first + 1

    def hash_vertices(self, table: int) -> tuple[np.ndarray, np.ndarray]:
        """First vertex and number of vertices along x, y, z of a hash table, [3] each.

        At least those of the cube over the longest side of the first bound.
        """
        resolution = self.hash_resolutions[table]
        scale = resolution / float(self.lattice.extent_m.max())
        low = np.subtract(self.bound.low, self.lattice.low) * scale
        high = np.subtract(self.bound.high, self.lattice.low) * scale
        first = np.minimum(np.floor(low + 1e-4), 0).astype(int)
        last = np.maximum(np.ceil(high - 1e-4), resolution).astype(int)
        return first, last - first + 1

    @cached_property
    def hash_resolutions(self) -> tuple[int, ...]:
        """Cells per longest side of the first bound, for each hash table (Co-SLAM's growth rule by level)."""
        c = self.config
        finest = max(
            float(self.lattice.extent_m.max()) / c.hash_finest_cell_m, c.hash_base_resolution
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
        """Entries of each table: one a vertex where it is dense, else 2^table_log2."""
        table = 1 << self.config.hash_table_log2
        return tuple(
            math.prod(map(int, self.hash_vertices(index)[1])) if dense else table
            for index, dense in enumerate(self.hash_is_dense)
        )

    @cached_property
    def hash_is_dense(self) -> tuple[bool, ...]:
        """Whether a table is indexed densely, x fastest, or by the XOR hash.

        Dense: where the (res + 1)^3 vertices of the first bound fit the table.
        """
        table = 1 << self.config.hash_table_log2
        return tuple((res + 1) ** 3 <= table for res in self.hash_resolutions)

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """All blocks by name, in memory order."""
        c = self.config
        shapes: list[tuple[str, tuple[int, ...]]] = []

        def add_planes(prefix: str, cell_m: float) -> None:
            n = self.plane_vertices(cell_m)[1].tolist()
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
        """Offset of the hash levels, or of the decoders if there are none."""
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
