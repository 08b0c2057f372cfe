"""A part of a turn that raises costs no other part; a needed one that does not recover ends the run."""

from hsslam_services.supervisor.guard import Guard


def _fail() -> None:
    raise OSError(24, "Too many open files")


def test_what_raises_is_reported_once_and_counted_and_the_rest_is_done():
    lines: list[str] = []
    done: list[int] = []
    guard = Guard(lines.append)
    for turn in range(50):
        guard.run("metrics", _fail)
        guard.run("processes", lambda turn=turn: done.append(turn), is_needed=True)
    assert len(done) == 50 and guard.failures == {"metrics": 50}
    assert len(lines) == 1 and "metrics" in lines[0] and "Too many open files" in lines[0]
    assert guard.hopeless_part() == ""


def test_a_needed_part_is_hopeless_until_it_works_again():
    guard = Guard(lambda _: None, patience_s=0.0)
    guard.run("processes", _fail, is_needed=True)
    assert guard.hopeless_part() == "processes"
    guard.run("processes", lambda: None, is_needed=True)
    assert guard.hopeless_part() == ""
