import math
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hsslam_node.geometry.se3 import se3_exp
from hsslam_proto import messages, run_messages, topics
from hsslam_proto.codec import Rejected, decode, encode, encoding_of
from hsslam_proto.pose_codec import (
    covariance_matrix,
    pose_matrix,
    pose_numbers,
    wire_covariance,
)

finite = st.floats(-1e6, 1e6)


def test_every_topic_has_its_own_key_and_schema():
    assert len({topic.name for topic in topics.TOPICS}) == len(topics.TOPICS)
    assert len({topic.schema for topic in topics.TOPICS}) == len(topics.TOPICS)
    assert topics.POSE.key("r1") == "hsslam/r1/out/pose"


@given(st.integers(0, 2**40), finite, finite, finite, st.sampled_from(["tracked", "lost"]))
def test_pose_round_trip(index, x, y, z, status):
    pose = _pose(index=index, t=(x, y, z), status=status)
    assert decode(topics.POSE, encode(topics.POSE, pose), encoding_of(topics.POSE)) == pose


@pytest.mark.parametrize("letter", ["x", "ü", "\U0001f916", "\ud800"])
def test_an_event_with_a_long_text_is_cut_and_fits(letter):
    event = run_messages.Event.now("tracker", "warning", 9000 * letter)
    payload = encode(topics.EVENT, event)
    assert len(payload) < topics.EVENT.size_limit_bytes
    back = decode(topics.EVENT, payload, encoding_of(topics.EVENT))
    assert isinstance(back, run_messages.Event) and len(back.text) > 1000


def test_frame_round_trip_shares_the_payload():
    frame = _frame()
    back = decode(topics.FRAME, encode(topics.FRAME, frame), encoding_of(topics.FRAME))
    assert isinstance(back, messages.Frame)
    assert bytes(back.color) == bytes(frame.color)
    assert isinstance(back.color, memoryview)


def test_the_numbers_that_the_document_tells_a_driver_to_draw_are_read():
    """Of those that fit into 64 bits without a sign, most are refused."""
    told = " ".join((messages.Frame.__doc__ or "").split())
    drawn = re.findall(r"`(\w+)` is a random number from `([\d*]+)` to `2\*\*(\d+) - 1`", told)
    assert [name for name, _, _ in drawn] == ["publisher", "odometry_series"]

    def is_read(name: str, number: int) -> bool:
        payload = encode(topics.FRAME, msgspec.structs.replace(_frame(), **{name: number}))
        return isinstance(decode(topics.FRAME, payload, encoding_of(topics.FRAME)), messages.Frame)

    for name, least, bits in drawn:
        base, _, power = least.partition("**")
        assert is_read(name, int(base) ** int(power or 1)) and is_read(name, 2 ** int(bits) - 1)
        assert not is_read(name, 2 ** int(bits))


def test_unknown_fields_are_ignored_and_new_ones_may_be_missing():
    raw = msgspec.msgpack.decode(encode(topics.POSE, _pose()))
    del raw["stage_ms"]
    payload = msgspec.msgpack.encode({**raw, "weather": [0.0] * 36})
    assert decode(topics.POSE, payload, encoding_of(topics.POSE)) == _pose()


@pytest.mark.parametrize(
    ("encoding", "reason"),
    [
        ("application/msgpack;hsslam.Pose.v2", "version"),
        ("application/msgpack;hsslam.Pose.v" + "9" * 5000, "version"),
        ("application/msgpack;hsslam.Frame.v1", "schema"),
        ("application/msgpack", "encoding"),
        ("zenoh/bytes", "encoding"),
        ("", "encoding"),
    ],
)
def test_foreign_encodings_are_rejected(encoding, reason):
    rejected = decode(topics.POSE, encode(topics.POSE, _pose()), encoding)
    assert isinstance(rejected, Rejected)
    assert rejected.reason == reason
    assert rejected.text.startswith("out/pose: ")
    assert len(rejected.text) < 300


def test_oversized_is_rejected_unread():
    payload = b"\xff" * (topics.POSE.size_limit_bytes + 1)
    rejected = decode(topics.POSE, payload, encoding_of(topics.POSE))
    assert isinstance(rejected, Rejected)
    assert rejected.reason == "size"


@given(st.binary(max_size=200))
def test_garbage_is_rejected_as_malformed(payload):
    rejected = decode(topics.POSE, payload, encoding_of(topics.POSE))
    assert isinstance(rejected, Rejected)
    assert rejected.reason == "malformed"


def test_deep_nesting_is_rejected():
    rejected = decode(topics.POSE, b"\x91" * 60_000, encoding_of(topics.POSE))
    assert isinstance(rejected, Rejected)


@pytest.mark.parametrize(
    "change",
    [
        {"fx": math.nan},
        {"fx": -1.0},
        {"cy": math.inf},
        {"depth_units_per_m": 0.0},
        {"width_px": 0},
        {"width_px": 9000},
        {"color": b"short"},
        {"depth_encoding": "zstd"},
        {"index": -1},
        {"index": "0"},
        {"color": None},
    ],
)
def test_bad_frames_are_rejected(change):
    raw = msgspec.msgpack.decode(encode(topics.FRAME, _frame()))
    payload = msgspec.msgpack.encode({**raw, **change})
    rejected = decode(topics.FRAME, payload, encoding_of(topics.FRAME))
    assert isinstance(rejected, Rejected)
    assert rejected.reason == "malformed"


@pytest.mark.parametrize("change", [{"q": (0.0, 0.0, 0.0, 2.0)}, {"t": (0.0, math.nan, 0.0)}])
def test_bad_poses_cannot_be_made(change):
    with pytest.raises(ValueError, match="pose"):
        _pose(**change)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"covariance": [0.0] * 20}, "covariance has 20 numbers: expected 21"),
        ({"covariance": [math.inf] * 21}, "covariance"),
        ({"odometry": [0.0] * 6}, "odometry has 6 numbers: expected 7"),
        ({"odometry": [0.0] * 7}, "unit quaternion"),
    ],
)
def test_bad_covariances_and_odometry_cannot_be_made(change, words):
    with pytest.raises(ValueError, match=words):
        _pose(**change)


def test_covariance_and_odometry_come_back_from_the_wire():
    A = np.random.default_rng(0).normal(size=(6, 6))
    covariance, T = A @ A.T, se3_exp(np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]))
    sent = _pose(covariance=wire_covariance(covariance), odometry=pose_numbers(T))
    came = decode(topics.POSE, encode(topics.POSE, sent), encoding_of(topics.POSE))
    assert isinstance(came, messages.Pose)
    np.testing.assert_array_equal(covariance_matrix(came.covariance), covariance)
    np.testing.assert_allclose(pose_matrix(came.odometry), T, atol=1e-15)
    assert covariance_matrix(wire_covariance(np.full((6, 6), math.nan))) is None


def test_encode_refuses_the_wrong_type_and_size():
    with pytest.raises(ValueError, match="expected Frame"):
        encode(topics.FRAME, _pose())  # type: ignore[arg-type]
    step = run_messages.SourceEnd(frame_count=1, reason="x" * 10_000)
    with pytest.raises(ValueError, match="at most 8192"):
        encode(topics.SOURCE_END, step)


def _pose(**change) -> messages.Pose:
    fields = {
        "index": 3,
        "stamp_ns": 5,
        "source_stamp_ns": 4,
        "publish_ns": 6,
        "status": "tracked",
        "t": (0.0, 1.0, 2.0),
        "q": (0.0, 0.0, 0.0, 1.0),
        "quality": 0.9,
        "inlier_ratio": 0.8,
        "residual_mm": 1.5,
        "map_version": 2,
        "keyframe": 0,
    }
    return messages.Pose(**{**fields, **change})  # type: ignore[arg-type]


def _frame() -> messages.Frame:
    color = np.arange(4 * 6 * 3, dtype=np.uint8)
    depth = np.arange(4 * 6, dtype="<u2")
    return messages.Frame(
        index=0,
        stamp_ns=1,
        source_stamp_ns=1,
        width_px=6,
        height_px=4,
        fx=5.0,
        fy=5.0,
        cx=2.5,
        cy=1.5,
        color=color.data.cast("B"),
        depth=depth.data.cast("B"),
        depth_units_per_m=5000.0,
    )
