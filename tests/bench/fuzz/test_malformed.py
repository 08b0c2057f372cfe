import random

import pytest

from hsslam_bench.fuzz.malformed import KINDS, malformed, too_large
from hsslam_bench.fuzz.samples import SAMPLES
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.requests import REQUESTS
from hsslam_proto.topics import TOPICS

TARGETS = [*TOPICS, *(request.asked for request in REQUESTS)]
BY_NAME = pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)


@BY_NAME
def test_nothing_of_what_is_drawn_can_be_read(target):
    rng = random.Random(0)
    for drawn in (malformed(target, rng) for _ in range(500)):
        if drawn.attachment is None:
            assert isinstance(decode(target, drawn.payload, drawn.encoding), Rejected)


@BY_NAME
def test_what_it_is_drawn_from_can_be_read(target):
    sample = SAMPLES[target.message]
    assert decode(target, encode(target, sample), encoding_of(target)) == sample
    rejected = decode(target, too_large(target).payload, encoding_of(target))
    assert isinstance(rejected, Rejected) and rejected.reason == "size"


def test_all_kinds_are_drawn_and_one_seed_draws_the_same():
    drawn = [[malformed(t, random.Random(3)) for t in TARGETS for _ in range(2)] for _ in range(2)]
    assert drawn[0] == drawn[1]
    rng = random.Random(0)
    assert {malformed(target, rng).kind for target in TARGETS * 40} == set(KINDS)
