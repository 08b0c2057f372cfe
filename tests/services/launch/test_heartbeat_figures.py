"""Figures that several threads use."""

import threading

from hsslam_services.launch.heartbeat_figures import HeartbeatFigures


def test_a_copy_is_of_its_moment():
    figures = HeartbeatFigures[float]()
    figures["a"] = 1.5
    figures.update({"b": 2.0}, c=3.0)
    copy = figures.copy()
    figures.add("a", 1.0)
    assert copy == {"a": 1.5, "b": 2.0, "c": 3.0}
    assert (figures["a"], figures.get("d", 0.5)) == (2.5, 0.5)


def test_copies_beside_additions_lose_nothing_and_never_fail():
    figures, rounds = HeartbeatFigures[int](), 2000
    copies: list[dict[str, int]] = []

    def add() -> None:
        for index in range(rounds):
            figures.add("all", 1)
            figures.update({f"left {index}": index, f"right {index}": index})

    adders = [threading.Thread(target=add) for _ in range(2)]
    for adder in adders:
        adder.start()
    while any(adder.is_alive() for adder in adders):
        copies.append(figures.copy())
    assert figures["all"] == 2 * rounds
    assert all(len(copy) % 2 == ("all" in copy) for copy in copies)  # both of a pair, or none
