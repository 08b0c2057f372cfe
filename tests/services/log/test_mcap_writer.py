import os
import resource
import signal
import subprocess
import sys

import msgspec
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from hsslam_proto import run_messages, topics
from hsslam_proto.codec import encode
from hsslam_proto.foxglove.poses import DrawnPoses
from hsslam_proto.foxglove.visualisation import viz_calibration, viz_messages
from hsslam_services.log.file_index import is_finished
from hsslam_services.log.mcap_writer import McapLog
from hsslam_services.log.parts import next_part, parts
from hsslam_services.log.recovery import recover
from tests.services.wire_samples import frame, mesh, pose


def test_the_public_reader_finds_exact_payloads(tmp_path):
    payloads = [encode(topics.POSE, pose(index)) for index in range(50)]
    log = McapLog(tmp_path / "run.mcap", "r")
    for index, payload in enumerate(payloads):
        log.write(topics.POSE, payload, 100 + index, 90 + index, index)
    assert log.close() == 0
    with (tmp_path / "run.mcap").open("rb") as stream:
        found = list(make_reader(stream).iter_messages())
    assert [message.data for _, _, message in found] == payloads
    schema, channel, message = found[7]
    assert schema is not None
    assert (channel.topic, channel.message_encoding) == ("hsslam/r/out/pose", "msgpack")
    assert (schema.name, schema.encoding) == ("hsslam.Pose.v1", "jsonschema")
    assert msgspec.json.decode(schema.data)["properties"]["q"]["minItems"] == 4
    assert (message.log_time, message.publish_time, message.sequence) == (107, 97, 7)


def test_the_viz_layer_is_foxglove_protobuf(tmp_path):
    log = McapLog(tmp_path / "run.mcap", "r")
    event = run_messages.Event(process="mapper", level="warning", text="slow", stamp_ns=7)
    drawn = DrawnPoses()
    poses = [*drawn.of(pose(3)), *drawn.of(pose(4, status="lost"))]
    others = (frame(3, compressed=True), mesh(), event)
    for viz in poses + [viz for message in others for viz in viz_messages(message, 50)]:
        log.write_viz(viz, 50, 40)
    log.write_viz(viz_calibration(frame(3)), 50, 40)
    log.close()
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        decoded = {c.topic: (s, m) for s, c, _, m in reader.iter_decoded_messages()}
    names = {topic: schema.name for topic, (schema, _) in decoded.items() if schema}
    assert names == {
        "/viz/camera/image": "foxglove.CompressedImage",
        "/viz/camera/calibration": "foxglove.CameraCalibration",
        "/viz/tf": "foxglove.FrameTransform",
        "/viz/pose": "foxglove.PoseInFrame",
        "/viz/odometry": "foxglove.Odometry",
        "/viz/mesh": "foxglove.SceneUpdate",
        "/viz/log": "foxglove.Log",
    }
    transform = decoded["/viz/tf"][1]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", "camera")
    assert transform.translation.x == pytest.approx(3.0)
    triangles = decoded["/viz/mesh"][1].entities[0].triangles[0]
    assert [(p.x, p.y, p.z) for p in triangles.points][1] == (1.0, 0.0, 2.0)
    assert list(triangles.indices) == [0, 1, 2, 0, 2, 3]
    assert triangles.colors[3].g == pytest.approx(1.0)
    assert triangles.colors[3].a == 1.0


def test_a_killed_writer_loses_at_most_a_second(tmp_path):
    path = tmp_path / "run.mcap"
    code = f"""
import time
from pathlib import Path
from hsslam_proto import topics
from hsslam_services.log.mcap_writer import McapLog
log = McapLog(Path({str(path)!r}), "r")
index = 0
while True:
    log.write(topics.STEP, b"x" * 5000, time.time_ns(), time.time_ns(), index)
    log.tick()
    index += 1
    print(index, flush=True)
    time.sleep(0.005)
"""
    writer = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    try:
        while int(writer.stdout.readline()) < 400:  # 2 s or more
            pass
    finally:
        writer.kill()
    written = int(["400", *writer.communicate()[0].split()[:-1]][-1])  # the last may be cut off
    with path.open("ab") as stream:  # and the last record torn
        stream.write(b"\x06\xff\x00\x00\x00\x00\x00\x00\x00torn")
    assert not is_finished(path)
    recovered = recover(path)
    assert is_finished(path)
    found = recovered.counts["hsslam/r/sys/step"]
    assert written - 250 <= found <= written + 1
    with path.open("rb") as stream:
        read = [message.sequence for _, _, message in make_reader(stream).iter_messages()]
    assert read == list(range(found))
    assert recovered.original is None
    assert recover(path).was_whole
    assert [part.name for part in parts(tmp_path)] == ["run.mcap"]
    assert next_part(tmp_path).name == "run.1.mcap"


def test_a_full_disk_loses_nothing_that_fits_later(tmp_path):
    """The limit on the file size plays the full disk; it is lifted before the end."""
    path = tmp_path / "run.mcap"
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    log = McapLog(path, "r")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, old[1]))
        for index in range(400):
            log.write(topics.STEP, os.urandom(4000), index, index, index)
            log._flushed_s = 0.0
            log.tick()
        assert log.space_is_short
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        signal.signal(signal.SIGXFSZ, ignored)
    assert log.close() == 0
    with path.open("rb") as stream:
        assert [m.sequence for _, _, m in make_reader(stream).iter_messages()] == list(range(400))


def test_short_space_is_seen_at_the_start(tmp_path):
    log = McapLog(tmp_path / "run.mcap", "r", reserve_bytes=2**62)
    assert log.space_is_short
    log.close()
