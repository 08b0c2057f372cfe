"""The end of a process: what it still has to do is done, though Python frees no memory."""

import time

from hsslam_services.launch.spawn import spawn
from hsslam_services.run.run_info import RunInfo
from hsslam_services.run.stop_signals import END_SIGNAL


def test_threads_and_exit_handlers_finish_and_objects_are_not_freed(run_info: RunInfo):
    (run_info.path / "behaviour").write_text("leaves something to its end")
    process = spawn("tests.services.sample_worker", run_info.path)
    deadline = time.monotonic() + 20
    while not (run_info.path / "at_work").exists():
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(END_SIGNAL)
    assert process.wait(20) == 0
    assert (run_info.path / "thread_ended").exists()
    assert (run_info.path / "atexit_called").exists()
    assert not (run_info.path / "freed").exists()
    log = (run_info.path / "logs" / "sample_worker.log").read_text()
    assert log.endswith("not flushed")
