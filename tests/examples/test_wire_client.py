"""The example client that uses nothing of this package; `control/test_ctl.py` runs it on a real run."""

from tests.repository import ROOT

EXAMPLE = ROOT / "examples/wire_client.py"


def test_it_needs_only_zenoh_and_msgpack():
    lines = EXAMPLE.read_text().splitlines()
    imported = {line.split()[1] for line in lines if line.startswith(("import ", "from "))}
    assert imported == {"json", "sys", "msgpack", "zenoh"}
    start = next(k for k, line in enumerate(lines) if line.startswith("import"))
    assert len([line for line in lines[start:] if line]) <= 22
