"""Options of the benchmark."""

from pathlib import Path

import pytest

from hsslam_bench.options import BenchOptions
from hsslam_node.errors import UserError


def test_the_result_is_a_file_beside_which_a_folder_of_its_name_has_room():
    assert BenchOptions(out=Path("bench/today.json")).out == Path("bench/today.json")
    with pytest.raises(UserError, match=r"--out bench: expected a name that ends in \.json"):
        BenchOptions(out=Path("bench"))


def test_a_folder_of_sequences_is_there():
    with pytest.raises(UserError, match="--data /no/data: no such folder"):
        BenchOptions(data=Path("/no/data"))
