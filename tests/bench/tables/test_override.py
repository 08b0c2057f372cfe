"""Changes to a configuration by name."""

import dataclasses

import pytest

from hsslam_bench.tables.options import parsed_overrides, with_overrides
from hsslam_node.errors import UserError
from hsslam_node.presets import PRESETS

PAPER = PRESETS["paper"]


def test_values_take_the_type_of_the_parameter():
    texts = ("mapper.rays=500", "weights.patch=0", "ba.enabled=false", "ba.selection=uniform")
    config = with_overrides(PAPER, parsed_overrides(texts))
    assert (config.mapper.rays, config.ba.enabled, config.ba.selection) == (500, False, "uniform")
    assert config.weights.patch == 0.0 and isinstance(config.weights.patch, float)
    expected = dataclasses.replace(
        PAPER,
        mapper=dataclasses.replace(PAPER.mapper, rays=500),
        weights=dataclasses.replace(PAPER.weights, patch=0.0),
        ba=dataclasses.replace(PAPER.ba, enabled=False, selection="uniform"),
    )
    assert config == expected


def test_twice_is_of_the_preset():
    for preset, channels in (("paper", 64), ("realtime", 32)):
        doubled = with_overrides(PRESETS[preset], {"field.plane_channels": "twice"})
        assert doubled.field.plane_channels == channels


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"mapper.ray": 5}, r"mapper\.ray: expected a parameter.*did you mean mapper\.rays\?"),
        ({"mapper": 5}, r"mapper: expected a parameter"),
        ({"mapper.rays": "many"}, r"mapper\.rays = many: expected a whole number, as 4000"),
        ({"ba.enabled": "perhaps"}, r"ba\.enabled = perhaps: expected true or false"),
        ({"mapper.rays": 0}, r"mapper\.rays = 0: expected 1 to 1000000"),
        ({"field.plane_channels": 24}, r"field\.plane_channels = 24: expected"),
    ],
)
def test_what_cannot_be_is_told(overrides, message):
    with pytest.raises(UserError, match=f"^{message}"):
        with_overrides(PAPER, overrides)


@pytest.mark.parametrize("text", ["mapper.rays", "=5", "mapper.rays="])
def test_text_without_a_value_is_told(text):
    with pytest.raises(UserError, match=r"expected GROUP\.FIELD=VALUE"):
        parsed_overrides((text,))
