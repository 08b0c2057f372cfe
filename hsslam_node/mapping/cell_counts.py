"""How many keyframes show each cell, counted in constant memory; apart because it knows no keyframes."""

import numpy as np

_BITS = 21  # of a place in a table: 2 x 4 MB
_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F], np.uint64)


class CellCounts:
    """A count-min sketch (Cormode and Muthukrishnan 2005): a count is exact, or too large if the cell shares
    a place in both tables, as one cell in a hundred does among 200 000."""

    def __init__(self) -> None:
        self._tables = np.zeros((2, 1 << _BITS), np.uint16)

    def places(self, cells: np.ndarray) -> np.ndarray:
        """Places of cells [n] int64 in the two tables, [2, n] int32."""
        mixed = cells.astype(np.uint64) * _FACTORS[:, None]  # modulo 2^64
        return (mixed >> np.uint64(64 - _BITS)).astype(np.int32)

    def of(self, places: np.ndarray) -> np.ndarray:
        """Counts [n] int64 of the cells at places [2, n]."""
        shown = np.minimum(self._tables[0, places[0]], self._tables[1, places[1]])
        return shown.astype(np.int64)

    def add(self, places: np.ndarray, one: int) -> None:
        """Add `one` to the cells: 1 if a keyframe shows them, -1 if it no longer does."""
        for table, place in zip(self._tables, places, strict=True):
            np.add.at(table, place, np.uint16(one % 65536))
