"""Which frames of a source are looked at."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from hsslam_node.doctor.examine import examine
from hsslam_node.doctor.sample import take_sample
from hsslam_node.doctor.stamps import recorded_stamps
from hsslam_node.errors import UserError
from hsslam_node.frame import Frame
from hsslam_node.sources.open_source import open_source
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions
from hsslam_node.sources.source import BadFrame, NoFrame, Source, SourceLostError

SMALL = SynthOptions(width_px=64, height_px=48)


def test_runs_of_three_spread_over_the_sequence():
    sample = take_sample("synth:room", SourceOptions(synth=SMALL), 12)
    assert sample.rows == (0, 1, 2, 199, 200, 201, 398, 399, 400, 597, 598, 599)
    assert [round(f.stamp_ns * 30e-9) for f in sample.frames] == list(sample.rows)
    assert [f.index for f in sample.spread] == [0, 3, 6, 9]
    assert [(a.index, b.index) for a, b in sample.pairs][:3] == [(0, 1), (1, 2), (3, 4)]
    np.testing.assert_allclose(sample.intervals_ns, 1e9 / 30, rtol=1e-6)
    assert len(sample.intervals_ns) == len(sample.pairs) == 8


def test_a_short_source_is_looked_at_whole(tum_folder):
    (tum_folder / "depth/2.png").unlink()
    sample = take_sample(f"tum:{tum_folder}", SourceOptions(), 60)
    assert (sample.frame_count, sample.rows) == (5, (0, 1, 2, 3, 4))
    assert ([f.index for f in sample.frames], [f.index for f in sample.bad]) == ([0, 1, 3, 4], [2])
    assert [(a.index, b.index) for a, b in sample.pairs] == [(0, 1), (3, 4)]
    assert len(sample.intervals_ns) == 4


def test_stamps_come_in_the_order_of_the_lists(tum_folder):
    lines = (tum_folder / "rgb.txt").read_text().splitlines()
    entries = [line for line in lines if not line.startswith("#")]
    (tum_folder / "rgb.txt").write_text("\n".join(reversed(entries)))
    stamps = recorded_stamps(f"tum:{tum_folder}")
    assert stamps is not None
    assert (np.diff(stamps.color_ns) < 0).all()
    assert (np.diff(stamps.depth_ns) > 0).all()
    assert recorded_stamps("synth:room") is None


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_camera_that_goes_silent_is_a_fault(is_lost):
    why = "nothing for 5 s: check the cable"

    class _Silent:
        def __init__(self, whole: Source) -> None:
            self.name, self.frame_count = whole.name, None
            self._whole = whole

        def frames(self, first: int = 0) -> Iterator[Frame | BadFrame]:
            yield from itertools.islice(self._whole.frames(first), 8)
            if is_lost:
                raise SourceLostError(why)
            while True:
                yield NoFrame(0, 0, why)

    options = SourceOptions(synth=SMALL)
    sample = take_sample("synth:room", options, 12, lambda *of: _Silent(open_source(*of)))
    assert (sample.silence, len(sample.frames), sample.bad) == (why, 8, ())
    by_name = {finding.name: finding for finding in examine(sample, None)}
    assert by_name["camera"].severity == "fault" and why in by_name["camera"].seen
    assert by_name["images"].severity == "ok"
    assert all(f.name != "camera" for f in examine(replace(sample, silence=""), None))


def test_a_source_that_is_not_there():
    with pytest.raises(UserError, match="no such folder"):
        take_sample("tum:nowhere", SourceOptions(), 6)
