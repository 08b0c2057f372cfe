"""Keys of rmw_zenoh."""

import zenoh

from hsslam_services.camera.ros2_messages import all_topics, topic_keys, topic_of, type_of

KEY = "0/camera/color/image_raw/sensor_msgs::msg::dds_::Image_/RIHS01_d31d41a9"


def test_a_key_is_told_apart():
    assert type_of(KEY) == "sensor_msgs/msg/Image"
    assert topic_of(KEY) == "/camera/color/image_raw"
    assert type_of("hsslam/robot/in/frame") == ""


def test_expressions_include_their_topics_and_no_others():
    key = zenoh.KeyExpr(KEY)
    assert zenoh.KeyExpr(topic_keys(0, "/camera/color/image_raw")).includes(key)
    assert not zenoh.KeyExpr(topic_keys(0, "/camera/color")).includes(key)
    assert not zenoh.KeyExpr(topic_keys(1, "/camera/color/image_raw")).includes(key)
    assert zenoh.KeyExpr(all_topics(0)).includes(key)
    assert not zenoh.KeyExpr(all_topics(0)).includes(zenoh.KeyExpr("0/chat/std_msgs::x/RIHS01"))
