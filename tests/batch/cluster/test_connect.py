"""Ray of this machine gets more than one chance to start; a cluster that is not there gets one."""

import pytest

from hsslam_batch.cluster.connect import connected
from hsslam_node.errors import UserError


@pytest.fixture
def starts(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The addresses that Ray was asked for; it starts at the third time."""
    import ray

    asked: list[str] = []

    def init(address: str, **_: object) -> None:
        asked.append(address)
        if len(asked) < 3:
            raise Exception("The current node timed out during startup.\nMore of it.")

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "shutdown", lambda: None)
    return asked


def test_ray_that_takes_too_long_to_start_is_started_again(starts: list[str]):
    with connected("local"):
        assert starts == ["local"] * 3


def test_a_cluster_that_does_not_answer_is_one_line(starts: list[str]):
    with (
        pytest.raises(UserError, match=r"^--address here:1: The current node timed out.*: exp"),
        connected("here:1"),
    ):
        pass
    assert starts == ["here:1"]
