from pathlib import Path

import pytest

from hsslam_services.governor.throttling import Throttling
from tests.services.governor.under_quota import printed_under_quota


def _stat(periods: int, throttled: int) -> str:
    return f"usage_usec 5\nnr_periods {periods}\nnr_throttled {throttled}\nthrottled_usec 7\n"


@pytest.mark.parametrize(
    ("own", "file"), [("0::/a\n", "a/cpu.stat"), ("2:cpu,cpuacct:/a\n", "cpu/a/cpu.stat")]
)
def test_the_share_of_the_last_ten_seconds(tmp_path: Path, own: str, file: str):
    (tmp_path / "own").write_text(own)
    stat = tmp_path / file
    stat.parent.mkdir(parents=True)
    stat.write_text(_stat(1000, 900))  # what came before this service does not count
    throttling = Throttling(tmp_path / "own", tmp_path)
    assert throttling.share(0.0) == 0.0
    for second in range(1, 11):
        stat.write_text(_stat(1000 + 10 * second, 900 + 3 * second))
        assert throttling.share(second + 0.01) == pytest.approx(0.3)
    stat.write_text(_stat(1110, 930))
    assert throttling.share(10.5) == pytest.approx(0.3)  # not read again within a second
    for second in range(11, 30):
        stat.write_text(_stat(1000 + 10 * second, 930))
        share = throttling.share(second + 0.01)
    assert share == 0.0


def test_the_group_that_is_throttled_most_counts(tmp_path: Path):
    (tmp_path / "own").write_text("0::/a/b\n")
    (tmp_path / "a/b").mkdir(parents=True)
    for file in ("a/cpu.stat", "a/b/cpu.stat"):
        (tmp_path / file).write_text(_stat(0, 0))
    throttling = Throttling(tmp_path / "own", tmp_path)
    throttling.share(0.0)
    (tmp_path / "a/cpu.stat").write_text(_stat(10, 6))
    (tmp_path / "a/b/cpu.stat").write_text(_stat(10, 2))
    assert throttling.share(2.0) == pytest.approx(0.6)


def test_it_begins_anew_with_the_counts_and_with_the_group(tmp_path: Path):
    (tmp_path / "own").write_text("0::/a\n")
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "cpu.stat").write_text(_stat(1000, 1000))
    throttling = Throttling(tmp_path / "own", tmp_path)
    throttling.share(0.0)
    (tmp_path / "a/cpu.stat").write_text(_stat(5, 0))
    assert throttling.share(1.0) == 0.0
    (tmp_path / "a/cpu.stat").write_text(_stat(15, 5))
    assert throttling.share(2.0) == pytest.approx(0.5)
    (tmp_path / "a/cpu.stat").write_text("")
    assert throttling.share(3.0) == 0.0
    (tmp_path / "own").write_text("0::/b\n")
    assert throttling.share(4.0) == 0.0
    (tmp_path / "b/cpu.stat").write_text(_stat(1010, 1009))
    assert throttling.share(5.0) == pytest.approx(0.9)


@pytest.mark.parametrize("text", ["", "usage_usec 5\n", "nr_periods many\n", "nr_periods\n"])
def test_without_counts_nothing_is_throttled(tmp_path: Path, text: str):
    (tmp_path / "own").write_text("0::/\n")
    (tmp_path / "cpu.stat").write_text(text)
    throttling = Throttling(tmp_path / "own", tmp_path)
    assert [throttling.share(float(s)) for s in range(3)] == [0.0, 0.0, 0.0]
    assert Throttling(tmp_path / "none", tmp_path).share(0.0) == 0.0


def test_the_kernel_throttles_a_process_that_uses_more_than_its_quota():
    code = (
        "import time\n"
        "from hsslam_services.governor.throttling import Throttling\n"
        "throttling = Throttling()\n"
        "first = throttling.share(time.monotonic())\n"
        "end = time.process_time() + 0.25\n"
        "while time.process_time() < end: pass\n"
        "print(first, throttling.share(time.monotonic() + 1.0))"
    )
    first, busy = map(float, printed_under_quota(code, 0.1).split())
    assert first == 0.0 and busy > 0.5
