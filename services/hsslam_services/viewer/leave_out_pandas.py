"""Keeps pandas out of a process that draws; alone, as it must come before the first use of rerun."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec


class _WithoutPandas(MetaPathFinder):
    """Pandas is not installed, as far as imports can find out."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: object = None
    ) -> ModuleSpec | None:
        if fullname == "pandas":
            raise ModuleNotFoundError("pandas is left out of this process", name=fullname)
        return None


def leave_out_pandas() -> None:
    """Let rerun's pyarrow do without pandas in this process.

    Pyarrow imports it, if it is installed, only to see that a list is no Series: 0.6 s of a core, 1.3 s
    without bytecode, while the first frames are tracked.
    """
    sys.meta_path.insert(0, _WithoutPandas())
