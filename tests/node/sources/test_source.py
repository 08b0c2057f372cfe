"""Options of the sources."""

import pytest

from hsslam_node.errors import UserError
from hsslam_node.sources.options.source import SourceOptions
from hsslam_node.sources.options.synth import SynthOptions


def test_selected_takes_every_nth_up_to_a_limit():
    assert list(SourceOptions(stride=3).selected(10)) == [0, 3, 6, 9]
    assert list(SourceOptions(stride=3, frames=2).selected(10)) == [0, 3]
    assert list(SourceOptions(start=4, stride=3, frames=9).selected(10)) == [4, 7]
    assert list(SourceOptions(start=10).selected(10)) == []
    assert list(SourceOptions(frames=99).selected(3)) == [0, 1, 2]


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: SourceOptions(noise="salt"), "noise"),  # type: ignore[arg-type]
        (lambda: SourceOptions(start=-1), "start"),
        (lambda: SourceOptions(start=10**25), "start"),
        (lambda: SourceOptions(stride=0), "stride"),
        (lambda: SourceOptions(frames=0), "frames"),
        (lambda: SourceOptions(seed=-1), "seed"),
        (lambda: SourceOptions(downscale=0), "downscale"),
        (lambda: SynthOptions(size_m=(1.0, 4.0, 2.5)), "size-m"),
        (lambda: SynthOptions(length=1), "length"),
        (lambda: SynthOptions(rate_hz=float("nan")), "rate-hz"),
    ],
)
def test_wrong_options_are_named(make, field):
    with pytest.raises(UserError, match=field):
        make()
