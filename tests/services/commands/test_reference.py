from hsslam_services.commands.all_options import OPTIONS, options_of
from hsslam_services.commands.options.option_table import option_table
from hsslam_services.commands.reference import reference
from hsslam_services.commands.serve_command_line import parse_command_line
from hsslam_services.run.options import ServeOptions
from tests.repository import ROOT


def test_every_command_and_option_is_in_the_document():
    text = reference()
    for command in list(OPTIONS)[1:]:
        assert f"# {command}\n" in text
        assert all(f"{o.value if o.is_positional else o.flag}" in text for o in options_of(command))


def test_the_document_is_current():
    assert reference() in (ROOT / "docs/cli.md").read_text()


def test_defaults_in_the_document_are_those_of_a_run_without_options():
    shown = [option.default_text() for option in options_of("hsslam-serve")]
    used = option_table(ServeOptions, parse_command_line([]))
    assert shown == [option.default_text() for option in used]
