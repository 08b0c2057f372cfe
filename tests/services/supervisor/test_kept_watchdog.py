"""A watchdog that is killed is started again, and no more after a crash loop."""

import psutil

from hsslam_services.arena.arena_folder import ArenaFolder
from hsslam_services.launch.restart_policy import RestartPolicy
from hsslam_services.supervisor.kept_watchdog import KeptWatchdog
from tests.until import until


def test_a_killed_watchdog_is_replaced_until_it_was_killed_too_often(tmp_path):
    arena = ArenaFolder("test", tmp_path, root=tmp_path)
    watchdog = KeptWatchdog(tmp_path, arena.path, RestartPolicy(0.0, 0.0))
    try:
        for _ in range(6):
            (process,) = _watchdogs()
            process.kill()
            until(lambda process=process: _is_over(process))
            watchdog.tick()
        assert watchdog.news[:-1] == ["watchdog was killed by SIGKILL: restart in 0 s"] * 5
        assert watchdog.news[-1].startswith("watchdog was killed by SIGKILL: too many restarts: if")
        assert _watchdogs() == []
        watchdog.tick()
        assert len(watchdog.news) == 6
    finally:
        arena.remove()
        watchdog.expect_end()


def _watchdogs() -> list[psutil.Process]:
    living = [child for child in psutil.Process().children() if not _is_over(child)]
    return [child for child in living if "hsslam_services.launch.watchdog" in child.cmdline()]


def _is_over(process: psutil.Process) -> bool:
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
