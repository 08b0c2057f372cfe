"""What a recorder knows of the recorder before it, which was killed."""

from pathlib import Path

from hsslam_proto import topics
from hsslam_proto.codec import encode
from hsslam_proto.envelope import Envelope
from hsslam_services.log.parted_log import LogSettings, PartedLog
from hsslam_services.log.recorded_so_far import RecordedSoFar
from tests.services.wire_samples import frame

_KEY = topics.FRAME.key("r")
_CAMERA, _OTHER_CAMERA = 7, 8


def _log(log: PartedLog, recorded: RecordedSoFar, camera: int, *sequences: int) -> None:
    """Log frames with these sequence numbers, in a chunk of their own."""
    for sequence in sequences:
        envelope = Envelope(camera, sequence, 1, 1000 + sequence)
        payload = encode(topics.FRAME, frame(sequence))
        assert log.write(topics.FRAME, payload, 1, envelope.publish_ns, sequence)
        recorded.add(_KEY, envelope)
    log._part._writer.flush()


def _killed_recorder(run_dir: Path) -> None:
    """It saves its state after frame 11, drops frames 12, 14 and 15, logs frame 16, and is killed."""
    recorded = RecordedSoFar(run_dir, "run-1")
    log = PartedLog(run_dir, "r", LogSettings(), lambda part: None)
    _log(log, recorded, _OTHER_CAMERA, 0, 1)
    _log(log, recorded, _CAMERA, *range(10), 11)
    recorded.save(*log.place, {_KEY: 1})
    _log(log, recorded, _CAMERA, 13, 16)


def test_frames_that_a_killed_recorder_dropped_in_its_last_second_are_counted(tmp_path):
    _killed_recorder(tmp_path)
    after = RecordedSoFar(tmp_path, "run-1")
    assert after.counts[_KEY] == 2 + 11 + 2
    assert after.dropped[_KEY] == 1 + 3
    assert after.awaited(_KEY) == {_CAMERA: 17, _OTHER_CAMERA: 2}
    assert after.has(_KEY, Envelope(_CAMERA, 16, 1, 1016))
    assert not after.has(_KEY, Envelope(_CAMERA, 17, 1, 1017))


def test_the_state_of_another_run_is_not_taken(tmp_path):
    _killed_recorder(tmp_path)
    after = RecordedSoFar(tmp_path, "run-2")
    assert after.counts[_KEY] == after.dropped[_KEY] == 0
    assert after.awaited(_KEY) == {}
