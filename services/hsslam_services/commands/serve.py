"""`hsslam-serve`: runs the service; imports little, so that an early signal prints no traceback."""

import os
import signal
import sys
from typing import NoReturn

_ONLY_MINE = 0o077  # folders 0700, files 0600


class EarlySignals:
    """Raises KeyboardInterrupt at SIGINT and SIGTERM before a run, and remembers it.

    The import of a compiled module, such as those of numpy, may catch the exception and go on.
    """

    def __init__(self) -> None:
        self._have_come = False
        # without a handler, the kernel drops a SIGTERM to the first process of a container
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._hear)

    def have_come(self) -> bool:
        """Whether a signal has come, although the program goes on."""
        return self._have_come

    def _hear(self, *_: object) -> NoReturn:
        self._have_come = True
        raise KeyboardInterrupt


def main() -> None:
    """Run the command; its exit codes are those of `ExitCode`."""
    signals = EarlySignals()
    try:
        from hsslam_services.commands.cli import exit_code

        sys.exit(exit_code(lambda: _serve(signals)))
    except KeyboardInterrupt:  # while Python starts
        _interrupted()


def _serve(signals: EarlySignals) -> int:
    try:
        if sys.argv[1:2] == ["warm-up"]:
            # no exception: the compiler catches some, and goes on
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, lambda *_: _interrupted())
            from hsslam_services.commands.warm_up import warm_up_command

            return warm_up_command(sys.argv[2:])
        os.umask(_ONLY_MINE)  # for all processes of the run: results, logs and folders
        if sys.argv[1:2] == ["rescue"]:
            from hsslam_services.commands.rescue import rescue_command

            return rescue_command(sys.argv[2:])
        from hsslam_services.commands.serve_command_line import parse_command_line

        options = parse_command_line(sys.argv[1:])
        from hsslam_node.kernels.cache_folder import writable_kernel_cache
        from hsslam_services.supervisor.supervisor import Supervisor  # late: --help is faster

        writable_kernel_cache()

        return Supervisor(options, signals.have_come).run()
    except KeyboardInterrupt:
        _interrupted()


def _interrupted() -> NoReturn:
    """End after a signal before a run, in warm-up or in rescue; later the supervisor handles signals.

    It uses `os._exit`, as a SIGINT while Python executes generated code (a dataclass) would kill Python.
    """
    text, code = "", 0
    match sys.argv[1:2]:
        case ["rescue"]:
            text, code = "unsaved results stay in memory", 4
        case ["warm-up"]:
            text, code = "the next warm-up or run compiles the rest", 1
    if text:
        print(f"{sys.argv[1]} interrupted: {text}", file=sys.stderr, flush=True)
    sys.stdout.flush()
    os._exit(code)


if __name__ == "__main__":
    main()
