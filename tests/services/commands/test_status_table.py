import msgspec

from hsslam_services.commands.ctl import print_status
from tests.services.health.sample_snapshot import snapshot


def test_everything_is_printed_as_it_is(capsys):
    status = snapshot({"mesher": "waiting"}).status
    print_status(msgspec.structs.replace(status, source="tum:/data/[/red] :dog:"))
    told = " ".join(capsys.readouterr().out.split())
    for words in ("tum:/data/[/red] :dog:", "100 sent, 96 tracked", "mesher:waiting", "mapper 1 x"):
        assert words in told
