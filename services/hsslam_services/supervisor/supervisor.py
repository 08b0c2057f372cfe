"""The supervisor: router, arena and processes of one run, from the first to the orderly end.

Subscribes: in/end, out/correction, out/keyframe, out/map, out/mesh, out/pose, sys/health, sys/event
Publishes: sys/event, sys/hold, sys/stop
Arena: reads pose_log; writes map_state
"""

import signal
from types import FrameType

from hsslam_node.kernels.cache_folder import warm_stamp
from hsslam_services.bus.bus import Bus
from hsslam_services.camera.open_source import expect_source
from hsslam_services.launch.fork_client import ForkClient
from hsslam_services.launch.one_shot import expect_end, start_watchdog
from hsslam_services.run.options import ServeOptions
from hsslam_services.supervisor.preparation import prepare
from hsslam_services.supervisor.run_loop import RunLoop


class Supervisor:
    """Runs until the source ends, a signal, or a failure that ends it; `run` gives the exit code.

    0: everything saved; 1: the tracker or the mapper could not be kept running; 2: bad input. The
    first SIGINT or SIGTERM stops in order, the second at once.
    """

    def __init__(self, options: ServeOptions) -> None:
        self._options = options
        self._signals = 0

    def run(self) -> int:
        """Start everything, keep it running, stop in order.

        Raises:
            UserError: the run cannot start.
        """
        expect_source(self._options)  # before the signals are ours: it may have to be fetched
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._signalled)
        prepared = prepare(self._options)
        fork_client = ForkClient(prepared.info.path)
        if warm_stamp().exists():
            fork_client.start()
        watchdog = start_watchdog(prepared.info)
        try:
            with Bus(prepared.info.endpoint, prepared.info.robot, "supervisor") as bus:
                run = RunLoop(prepared, bus, fork_client, lambda: self._signals)
                try:
                    return run.to_the_end()
                finally:
                    run.kill_all()
        finally:
            fork_client.close()
            prepared.close()
            expect_end(watchdog)

    def _signalled(self, _number: int, _frame: FrameType | None) -> None:
        self._signals += 1
