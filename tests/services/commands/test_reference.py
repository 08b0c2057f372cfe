from hsslam_services.commands.all_options import OPTIONS, options_of
from hsslam_services.commands.reference import reference
from tests.repository import ROOT


def test_every_command_and_option_is_in_the_document():
    text = reference()
    for command in list(OPTIONS)[1:]:
        assert f"# {command}\n" in text
        assert all(f"{o.value if o.is_positional else o.flag}" in text for o in options_of(command))


def test_the_document_is_current():
    assert reference() in (ROOT / "docs/cli.md").read_text()
