"""Keeps pandas out of a process that draws; alone, as it must run before the first use of rerun."""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec


class _WithoutPandas(MetaPathFinder):
    """Lets imports of pandas fail."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: object = None
    ) -> ModuleSpec | None:
        if fullname == "pandas":
            raise ModuleNotFoundError("pandas is left out of this process", name=fullname)
        return None


def leave_out_pandas() -> None:
    """Prevent pyarrow, which rerun uses, from importing pandas in this process.

    Pyarrow would import it only to check that a list is no Series. That takes 0.6 s of a core, 1.3 s without
    bytecode, during the first frames.
    """
    sys.meta_path.insert(0, _WithoutPandas())
