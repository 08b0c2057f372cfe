"""Options as rows, what --help shows of them, and how they are parsed, for every command."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, Literal

import pytest

from hsslam_node.errors import UserError
from hsslam_services.commands.all_options import OPTIONS, options_class, options_of
from hsslam_services.commands.cli import parse_options
from hsslam_services.commands.options.option_table import group_purposes
from hsslam_services.run.options import ServeOptions


@dataclass(frozen=True)
class Inner:
    """A group."""

    limits: tuple[float, float] = (0.0, 1.0)
    """Low and high, m."""
    on: bool = True
    """Whether it is on."""


@dataclass(frozen=True)
class Sample:
    """A command."""

    POSITIONALS: ClassVar = ("what", "more")
    ALIASES: ClassVar = {"out": "-o"}

    what: str = ""
    """What."""
    more: tuple[int, ...] = ()
    """More."""
    out: Path | None = None
    """Where to."""
    size: Literal[16, 32] = 16
    """How large, px."""
    names: tuple[str, ...] = ()
    """Who."""
    json: bool = False
    """As JSON."""
    count: int | None = 7
    """How many (none: all)."""
    inner: Inner = field(default_factory=Inner)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("", Sample()),
        ("--json a 1 2 -o x", Sample("a", (1, 2), Path("x"), json=True)),
        (
            "a --size 32 --names b c --json 3",
            Sample("a", (3,), size=32, names=("b", "c"), json=True),
        ),
        ("--names a --names=b", Sample(names=("a", "b"))),
        ("--count none", Sample(count=None)),
        ("--inner.limits -1 -0.5", Sample(inner=Inner((-1.0, -0.5)))),
        ("--inner.limits -6.1e-17 -inf", Sample(inner=Inner((-6.1e-17, float("-inf"))))),
        ("-o ~/x", Sample(out=Path.home() / "x")),
        ("--inner.no-on --no-json --inner.on --inner.no-on", Sample(inner=Inner(on=False))),
        ("--inner.limits 1 2 --size 32 --size 16", Sample(inner=Inner((1.0, 2.0)))),
    ],
)
def test_lines_become_options(line: str, expected: Sample):
    assert parse_options(Sample, "sample", line.split()) == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("--size 17", "--size 17: expected 16 or 32"),
        ("a b", "MORE b: expected a whole number"),
        ("-o", "--out: missing value: expected --out FILE"),
        ("--json=yes", "--json: value: expected --json alone"),
        ("--outt x", "--outt: unknown option; did you mean --out?"),
        ("--limits 1 2", "--limits: unknown option; did you mean --inner.limits?"),
        ("-- --json", "--json: is taken for a value, as it stands after --: expected it before --"),
    ],
)
def test_a_mistake_is_one_line(line: str, message: str):
    with pytest.raises(UserError) as caught:
        parse_options(Sample, "sample", line.split())
    assert str(caught.value) == message


@pytest.mark.parametrize("command", [name for name, target in OPTIONS.items() if target])
def test_every_option_of_every_command_is_explained(
    command: str, capsys: pytest.CaptureFixture[str]
):
    cls = options_class(command)
    assert cls is not None
    table = options_of(command)
    unexplained = [option.name for option in table if not option.help]
    assert not unexplained
    assert all(group_purposes(cls).values())
    assert sum(option.is_basic for option in table) <= 42
    for question in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as ended:
            parse_options(cls, command, [question])
        assert not ended.value.code
        shown = capsys.readouterr().out
        for option in table:
            name = option.value if option.is_positional else f"{option.flag}"
            assert name in shown or (question == "--help" and not option.is_basic)
        assert "Raises" not in shown


def test_a_file_that_must_be_given_has_no_default():
    assert [option.default_text() for option in options_of("hsslam-bench compare")] == ["", ""]
    assert options_of("hsslam-batch run")[0].default_text() == "."


def test_the_basic_options_exist_and_have_one_line_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("COLUMNS", "120")
    names = {option.name for option in options_of("hsslam-serve")}
    groups = {name.rpartition(".")[0] for name in names}
    assert set(ServeOptions.BASIC) <= names | groups
    assert set(ServeOptions.VALUES) <= names
    with pytest.raises(SystemExit):
        parse_options(ServeOptions, "hsslam-serve", ["--help"])
    lines = capsys.readouterr().out.partition("\nOptions:\n")[2].splitlines()
    continued = [line for line in lines if line.startswith(" " * 20)]
    assert len(continued) <= 2, continued  # names that need a line of their own
