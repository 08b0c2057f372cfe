"""What a complete log holds: a frame that the camera sent again is there again."""

from hsslam_bench.checks.live_figures import messages_expected


def test_the_log_of_a_run_whose_first_frame_was_sent_again():
    frames = {"in": 12, "tracked": 1, "lost": 10, "dropped": 1}
    counters = {"sent": 12, "bad": 0}
    once = {"frames": frames, "processes": {"camera": {"counters": counters}}}
    twice = {"frames": frames, "processes": {"camera": {"counters": {**counters, "resent": 1}}}}
    assert messages_expected(once) == {"in/frame": 12, "out/pose": 11}
    assert messages_expected(twice) == {"in/frame": 13, "out/pose": 11}
