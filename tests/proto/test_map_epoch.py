"""Messages of two map epochs in any order."""

import msgspec

from hsslam_proto.map_epoch import EpochOrder
from tests.services.wire_samples import frame, keyframe, pose


def test_a_map_epoch_begins_once_and_what_is_of_the_old_is_past():
    epochs = EpochOrder()
    old, new = pose(1), msgspec.structs.replace(keyframe(0), map_epoch=2)
    assert not epochs.begins_with(old) and not epochs.is_past(old)
    assert epochs.begins_with(new) and epochs.now == 2
    assert not epochs.begins_with(new) and not epochs.is_past(new)
    assert epochs.is_past(old)
    for of_any in (frame(1),):
        assert not epochs.begins_with(of_any) and not epochs.is_past(of_any)
