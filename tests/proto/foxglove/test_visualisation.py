"""The /viz layer of a log against the schemas as published, and opened by other people's programs."""

import importlib
import subprocess
from pathlib import Path

import numpy as np
import pytest
import rerun_cli
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from mcap.reader import make_reader

from hsslam_node.geometry.se3 import transform
from hsslam_proto.foxglove.visualisation import viz_messages
from tests.services.log.sample_log import write_log
from tests.services.wire_samples import grid

RERUN = str(Path(rerun_cli.__file__).parent / "rerun")


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> Path:
    return write_log(tmp_path_factory.mktemp("log"), count=6, color="jpeg")


def test_embedded_schemas_are_those_published_and_read_every_message(log):
    read: dict[str, int] = {}
    with log.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages():
            if not channel.topic.startswith("/viz/"):
                continue
            assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
            files = FileDescriptorSet.FromString(schema.data).file
            pool = descriptor_pool.DescriptorPool()
            for file in files:  # in the order of what they import
                pool.Add(file)
                assert file == _published(file.name)
            kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            parsed = kind.FromString(message.data)
            assert parsed.SerializeToString() and not list(_unknown(parsed))
            read[schema.name] = read.get(schema.name, 0) + 1
    assert read.keys() == {
        f"foxglove.{name}"
        for name in (
            *("CompressedImage", "CameraCalibration", "FrameTransform", "PoseInFrame"),
            *("Odometry", "SceneUpdate", "Log", "Grid"),
        )
    }


def test_a_grid_is_drawn_where_it_lies():
    message = grid(3)
    (viz,) = viz_messages(message, message.stamp_ns)
    drawn = viz.schema.FromString(viz.payload)
    assert (viz.topic, drawn.frame_id, drawn.column_count) == ("/viz/grid", "world", 10)
    colors = np.frombuffer(drawn.data, np.uint8).reshape(15, drawn.row_stride // 4, 4)
    assert (colors[13, 9] == 0).all() and colors[7, 5, 0] < 100 < 200 < colors[0, 0, 0]
    assert [field.name for field in drawn.fields] == ["red", "green", "blue", "alpha"]
    t, q = drawn.pose.position, drawn.pose.orientation
    T = transform(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))
    np.testing.assert_allclose(T[:3, 2], [0, -1, 0], atol=1e-9)  # z of the grid is up
    np.testing.assert_allclose(T[:3, 3], message.t)


def test_rerun_finds_nothing_to_complain_about_and_converts_it(log, tmp_path):
    checked = subprocess.run([RERUN, "mcap", "check", log], capture_output=True, text=True)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    converted = tmp_path / "run.rrd"
    command = [RERUN, "mcap", "convert", log, "-o", converted]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert converted.stat().st_size > 1000


def _published(name: str) -> FileDescriptorProto:
    """The file descriptor of a module of foxglove-schemas-protobuf, or of protobuf itself."""
    module = Path(name).with_suffix("").name + "_pb2"
    package = "google.protobuf" if name.startswith("google/") else "foxglove_schemas_protobuf"
    found = FileDescriptorProto()
    importlib.import_module(f"{package}.{module}").DESCRIPTOR.CopyToProto(found)
    return found


def _unknown(message):
    """Fields on the wire that the schema does not have, at any depth."""
    from google.protobuf.unknown_fields import UnknownFieldSet

    yield from UnknownFieldSet(message)
    for field, value in message.ListFields():
        if field.message_type is not None:
            for inner in value if field.is_repeated else [value]:
                yield from _unknown(inner)
