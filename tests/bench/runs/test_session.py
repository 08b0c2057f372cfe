from pathlib import Path

import pytest

from hsslam_bench.runs.serve_run import RunFailedError
from hsslam_bench.runs.session import Session


@pytest.mark.parametrize("printed", ["{\n", "", 'a warning\n{"a": 1}\nanother\n'])
def test_a_module_that_ends_without_json_is_a_failed_run(tmp_path: Path, printed: str):
    session = Session(tmp_path, tmp_path / "runs", outputs={("some.module", "0"): printed})
    with pytest.raises(RunFailedError, match=r"some.module printed '.*': expected JSON"):
        session.figures("some.module", "0")


def test_what_libraries_print_before_the_figures_is_left_out(tmp_path: Path):
    printed = 'a warning\n{"a": 1}\n'
    session = Session(tmp_path, tmp_path / "runs", outputs={("some.module", "0"): printed})
    assert session.figures("some.module", "0") == {"a": 1}
