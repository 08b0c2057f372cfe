from dataclasses import replace

import numpy as np
import pytest

from hsslam_bench.field_error.run import ask
from hsslam_bench.field_error.true_frames import true_frames
from hsslam_node.evaluation.mesh.tsdf_baseline import TsdfVolume
from tests.small_room import OPTIONS, SMALL

_QUICK = replace(OPTIONS, frames=15)


def test_the_map_of_exact_depth_lies_on_the_true_surface() -> None:
    found = list(ask(SMALL, true_frames("synth:room", _QUICK), 0))
    assert [asked.seen.max() for asked in found] == [1, 2, 3, 4]
    error_m = np.concatenate([asked.distance_m for asked in found])
    assert np.isfinite(error_m).mean() > 0.9
    assert abs(np.nanmedian(error_m)) < 0.005


def test_the_tsdf_of_exact_depth_does_as_well(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("open3d", exc_type=ImportError)
    found = list(ask(SMALL, true_frames("synth:room", _QUICK), 0, TsdfVolume()))
    assert found[-1].tsdf_m is not None
    assert np.isfinite(found[-1].tsdf_m).mean() > 0.5
    assert abs(np.nanmedian(found[-1].tsdf_m)) < 0.005
    assert capfd.readouterr().out == ""  # where the figures go: Open3D warns there
