"""Messages of two worlds in any order."""

import msgspec

from hsslam_proto.map_epoch import EpochOrder
from tests.services.wire_samples import frame, keyframe, pose


def test_a_world_begins_once_and_what_is_of_the_old_is_past():
    worlds = EpochOrder()
    old, new = pose(1), msgspec.structs.replace(keyframe(0), world=2)
    assert not worlds.begins_with(old) and not worlds.is_past(old)
    assert worlds.begins_with(new) and worlds.now == 2
    assert not worlds.begins_with(new) and not worlds.is_past(new)
    assert worlds.is_past(old)
    for of_any in (frame(1),):
        assert not worlds.begins_with(of_any) and not worlds.is_past(of_any)
