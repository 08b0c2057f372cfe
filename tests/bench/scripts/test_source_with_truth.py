from pathlib import Path

import pytest

from hsslam_bench.scripts.source_with_truth import source_with_truth
from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions


def test_the_truth_is_of_the_frames_that_the_options_select() -> None:
    source, truth = source_with_truth("synth:room", SourceOptions(start=3, stride=2, frames=5))
    assert source.frame_count == len(truth.T_world_cam) == 5
    first = next(iter(source.frames()))
    assert first.stamp_ns == truth.stamps_ns[0]


def test_a_source_without_truth_is_refused(tum_folder: Path) -> None:
    (tum_folder / "groundtruth.txt").unlink(missing_ok=True)
    with pytest.raises(UserError, match="expected a true pose for every frame"):
        source_with_truth(f"tum:{tum_folder}", SourceOptions())
