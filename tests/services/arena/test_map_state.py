"""The mode of a run, as one process sets it and others see it."""

from hsslam_services.arena.map_state import MapState


def test_what_one_sets_all_see_at_once(tmp_path):
    supervisor = MapState.create(tmp_path, localise_only=True)
    worker = MapState(tmp_path)
    assert worker.localise_only
    supervisor.localise_only = False
    assert not worker.localise_only


def test_a_map_that_is_given_up_or_only_localised_in_may_not_change(tmp_path):
    supervisor = MapState.create(tmp_path, localise_only=False)
    worker = MapState(tmp_path)
    assert worker.may_change and worker.map_epoch == 0
    supervisor.is_given_up = True
    assert worker.is_given_up and not worker.may_change
    supervisor.is_given_up, supervisor.map_epoch = False, 1
    assert worker.may_change and worker.map_epoch == 1
    supervisor.localise_only = True
    assert not worker.may_change
