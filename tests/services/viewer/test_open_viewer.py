"""A recorder that is restarted goes on in the native viewer of the one before."""

import psutil

from hsslam_services.viewer.open_viewer import OpenViewer
from hsslam_services.viewer.rerun_process import ViewerProcess
from hsslam_services.viewer.view import RerunView
from tests.services.wire_samples import pose


def test_the_viewer_of_an_earlier_recorder_is_used_while_it_is_open(tmp_path):
    server = ViewerProcess("web")  # takes data as a native viewer does, and needs no screen
    try:
        assert server.wait_until_it_listens(lambda: False)
        OpenViewer(tmp_path, "r").note(server)
        assert OpenViewer(tmp_path, "r").url() == server.url
        assert OpenViewer(tmp_path, "of another run").url() is None
        before, reports = _children(), []
        view = RerunView(
            tmp_path / "run.rrd", "spawn", "r", lambda level, text: reports.append(text)
        )
        view.show(pose(0))
        assert _children() == before
        view.close()
        assert reports == [] and view.dropped == 0
        assert OpenViewer(tmp_path, "r").url() is None  # the run has ended
        OpenViewer(tmp_path, "r").note(server)
    finally:
        server.close()
    assert OpenViewer(tmp_path, "r").url() is None


def _children() -> set[int]:
    """The processes that this one has started."""
    return {child.pid for child in psutil.Process().children()}
