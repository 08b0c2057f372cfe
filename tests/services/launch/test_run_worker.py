"""The end of a process: what it still has to do is done, though Python frees no memory."""

from hsslam_services.launch.spawn import spawn
from hsslam_services.run.run_info import RunInfo


def test_threads_and_exit_handlers_finish_and_output_is_written(run_info: RunInfo):
    (run_info.path / "behaviour").write_text("leaves something to its end")
    process = spawn("tests.services.sample_worker", run_info.path)
    while not (run_info.path / "at_work").exists():
        assert process.poll() is None
    process.terminate()
    assert process.wait(20) == 0
    assert (run_info.path / "thread_ended").exists()
    assert (run_info.path / "atexit_called").exists()
    log = (run_info.path / "logs" / "sample_worker.log").read_text()
    assert log.endswith("not flushed")
