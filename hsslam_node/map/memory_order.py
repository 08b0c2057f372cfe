"""Ordered loads and stores of the counters that say which shared data are complete, on every processor.

x86 keeps stores in order, ARM does not: there, another process may see a counter before the data it
counts. A full fence on each side of a counter's load or store makes it an acquire or a release. LLVM
makes the fence for this machine (`dmb ish` on ARM); a Python lock is not enough there.
"""

import ctypes
from collections.abc import Callable
from functools import cache

import numpy as np

_ENGINES: list[object] = []
FENCE = """
define void @fence() {
  fence seq_cst
  ret void
}
"""


def load_ordered(words: np.ndarray, field: int) -> int:
    """Read `words[field]` ([n] of 8 bytes) as an acquire: later reads see the data that it counts."""
    fence = _fence()
    fence()
    value = int(words[field])
    fence()
    return value


def store_ordered(words: np.ndarray, field: int, value: int) -> None:
    """Write `words[field]` ([n] of 8 bytes) as a release: other processes see earlier writes first."""
    fence = _fence()
    fence()
    words[field] = value
    fence()


@cache
def _fence() -> Callable[[], None]:
    """The fence as a function, made by LLVM at the first call in a process."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(FENCE), machine)
    engine.finalize_object()
    _ENGINES.append(engine)  # owns the code
    return ctypes.CFUNCTYPE(None)(engine.get_function_address("fence"))
