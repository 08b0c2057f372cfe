"""Where machine code of kernels is kept."""

from pathlib import Path
from typing import Any

import numba
import pytest
from numba.core import config

from hsslam_node.kernels.cache_folder import kernel_cache_folder
from hsslam_node.kernels.compiled import njit


@pytest.mark.parametrize("is_named", [False, True])
def test_kernels_are_kept_where_warm_up_puts_them_and_other_functions_where_numba_does(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, is_named: bool
):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path) if is_named else "")
    ours, others = njit(cache=True)(_twice), numba.njit(cache=True)(_twice)
    assert kernel_cache_folder() in Path(str(ours.stats.cache_path)).parents
    place = Path(str(others.stats.cache_path))
    assert tmp_path in place.parents if is_named else place == Path(__file__).parent / "__pycache__"


def test_a_kernel_that_can_be_kept_nowhere_is_compiled_all_the_same():
    names: dict[str, Any] = {}
    exec(
        "def thrice(x): return 3 * x", names
    )  # of no file: for numba as if no folder could be written
    with pytest.raises(RuntimeError, match="no locator"):
        numba.njit(cache=True)(names["thrice"])
    assert njit(cache=True)(names["thrice"])(2) == 6


def _twice(x):
    return 2 * x
