"""Keys, tokens and attachments, beside the examples of rmw_zenoh's design document and zenoh's own codec."""

import zenoh.ext
from zenoh.ext import Int64

from hsslam_services.camera.ros2_messages import topic_of, type_of
from hsslam_services.ros2.names import NodeName, Qos, TopicName, all_tokens, attachment, gid
from tests.repository import ROOT

_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
_CHATTER = TopicName("/chatter", "std_msgs/msg/String", _HASH)


def test_the_example_of_the_design():
    node = NodeName(0, "aac3178e146ba6f1fc6e6a4085e77f21", "listener")
    assert node.token() == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    talker = NodeName(0, "8b20917502ee955ac4476e0266340d5c", "talker")
    assert talker.publisher_token(10, _CHATTER, Qos(7)) == (
        "@ros2_lv/0/8b20917502ee955ac4476e0266340d5c/0/10/MP/%/%/talker/%chatter/"
        f"std_msgs::msg::dds_::String_/{_HASH}/::,7:,:,:,,"
    )
    assert _CHATTER.key(0) == f"0/chatter/std_msgs::msg::dds_::String_/{_HASH}"


def test_a_namespace_and_a_topic_below_it_are_one_part_each():
    node = NodeName(3, "ab", "slam", "/robots/one")
    token = node.publisher_token(1, TopicName("/robots/one/odom", "a/msg/B", "H"), Qos(10))
    assert token.split("/")[5:10] == ["MP", "%", "%robots%one", "slam", "%robots%one%odom"]
    assert zenoh.KeyExpr(all_tokens(3)).includes(zenoh.KeyExpr(token))


def test_what_is_as_by_default_stays_empty():
    assert Qos(42).text() == "::,:,:,:,,"
    assert Qos(1, is_latched=True).text() == ":1:,1:,:,:,,"
    assert Qos(5, is_reliable=False).text() == "2::,5:,:,:,,"


def test_our_reader_of_keys_reads_them():
    key = TopicName("/hsslam/points", "sensor_msgs/msg/PointCloud2", _HASH).key(0)
    assert topic_of(key) == "/hsslam/points"
    assert type_of(key) == "sensor_msgs/msg/PointCloud2"


def test_the_page_names_the_first_rmw_zenoh_that_reads_our_attachments():
    """Pull request 601 of rmw_zenoh removed the names of their fields."""
    told = " ".join((ROOT / "docs/ros2.md").read_text().split())
    assert "of Jazzy 0.2.4 (April 2025) or newer, or of a newer ROS" in told


def test_an_attachment_is_what_zenoh_serialises():
    publisher = gid("@ros2_lv/0/a/0/1/MP/%/%/b")
    theirs = zenoh.ext.z_serialize((Int64(7), Int64(1_700_000_000_000_000_000), publisher))
    assert attachment(7, 1_700_000_000_000_000_000, publisher) == theirs.to_bytes()


def test_a_gid_is_the_hash_with_its_low_half_first():
    low, high = (
        0x6001C324468D497F,
        0x99AA06D3014798D8,
    )  # XXH3-128 of nothing, from the specification
    assert gid("") == low.to_bytes(8, "little") + high.to_bytes(8, "little")
