"""Figures that several threads use."""

import threading

from hsslam_proto.message import LONGEST_NAME, MOST_FIGURES
from hsslam_services.launch.heartbeat_figures import HeartbeatFigures


def test_a_copy_is_of_its_moment():
    figures = HeartbeatFigures[float]()
    figures["a"] = 1.5
    figures.update({"b": 2.0}, c=3.0)
    copy = figures.copy()
    figures.add("a", 1.0)
    assert copy == {"a": 1.5, "b": 2.0, "c": 3.0}
    assert (figures["a"], figures.get("d", 0.5)) == (2.5, 0.5)


def test_names_from_outside_fit_into_a_heartbeat():
    figures, long = HeartbeatFigures[int](), f"/{'a' * 100}/{'b' * 97}: unusable messages"
    assert [figures.add(long, 1) for _ in range(2)] == [1, 2] and figures[long] == 2
    (name,) = figures.copy()
    assert len(name) <= LONGEST_NAME
    assert name.startswith("/aaa") and name.endswith("b: unusable messages")
    for index in range(MOST_FIGURES + 10):
        figures.add(f"name {index}", 1)
    figures.update({"one more": 5})
    assert len(figures.copy()) == MOST_FIGURES and figures["others"] == 5
    assert figures["name 0"] == 1


def test_copies_beside_additions_lose_nothing_and_never_fail():
    figures, rounds = HeartbeatFigures[int](), 2000
    copies: list[dict[str, int]] = []

    def add() -> None:
        for index in range(rounds):
            figures.add("all", 1)
            figures.update({f"left {index % 100}": index, f"right {index % 100}": index})

    adders = [threading.Thread(target=add) for _ in range(2)]
    for adder in adders:
        adder.start()
    while any(adder.is_alive() for adder in adders):
        copies.append(figures.copy())
    assert figures["all"] == 2 * rounds
    assert all(len(copy) % 2 == ("all" in copy) for copy in copies)  # both of a pair, or none
