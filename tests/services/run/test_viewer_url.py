"""Addresses of viewers that other programs started."""

import pytest
import rerun as rr

from hsslam_node.errors import UserError
from hsslam_services.run.viewer_url import viewer_url


@pytest.mark.parametrize(
    ("viewer", "expected"),
    [
        ("connect:127.0.0.1:9876", "rerun+http://127.0.0.1:9876/proxy"),
        ("connect:[::1]:9876", "rerun+http://[::1]:9876/proxy"),
        ("connect:rerun+http://laptop:9876/proxy", "rerun+http://laptop:9876/proxy"),
        ("connect:rerun+https://laptop/proxy", "rerun+https://laptop/proxy"),
    ],
)
def test_rerun_takes_the_address(viewer, expected):
    assert viewer_url(viewer) == expected
    rr.GrpcSink(expected)


@pytest.mark.parametrize(
    "address",
    [
        *("", "laptop", "127.0.0.1:99999", "127.0.0.1:0", "127.0.0.1:port", "[::1:9876", ":9876"),
        *("http://127.0.0.1:9876/proxy", "rerun+http://127.0.0.1:9876", "gopher://x", "a b:9876"),
    ],
)
def test_another_one_is_a_line_before_anything_starts(address):
    with pytest.raises(UserError, match=r"expected connect:HOST:PORT or connect:rerun\+http"):
        viewer_url(f"connect:{address}")
