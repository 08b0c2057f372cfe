"""The mode of a run, as one process sets it and others see it."""

from hsslam_node.services.run_mode import RunMode


def test_what_one_sets_all_see_at_once(tmp_path):
    supervisor = RunMode.create(tmp_path, localise_only=True)
    worker = RunMode(tmp_path)
    assert worker.localise_only
    supervisor.localise_only = False
    assert not worker.localise_only
