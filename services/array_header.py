"""What an array of the arena says of itself: `<name>.json`, which appears when it is ready."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class ArrayHeader(NamedTuple):
    """Type and shape of an array."""

    dtype: np.dtype
    shape: tuple[int, ...]

    def write(self, path: Path) -> None:
        """Write it in one step."""
        descr = np.lib.format.dtype_to_descr(self.dtype)
        partial = path.with_suffix(".tmp")
        partial.write_text(json.dumps({"dtype": descr, "shape": list(self.shape)}))
        partial.replace(path)

    @staticmethod
    def read(path: Path) -> "ArrayHeader":
        """The header in a file; KeyError with the array's name if there is none yet."""
        try:
            header = json.loads(path.read_text())
        except FileNotFoundError:
            raise KeyError(path.stem) from None
        return ArrayHeader(_dtype(header["dtype"]), tuple(header["shape"]))


def _dtype(descr: Any) -> np.dtype:
    """The dtype of a descriptor that JSON has turned from tuples into lists."""
    if isinstance(descr, str):
        return np.dtype(descr)
    fields: Any = [
        (field[0], _dtype(field[1]).descr if isinstance(field[1], list) else field[1])
        + ((tuple(field[2]),) if len(field) > 2 else ())
        for field in descr
    ]
    return np.lib.format.descr_to_dtype(fields)
