"""`hsslam-serve warm-up`: compiles all kernels before the first run."""

import os
import time
from collections.abc import Sequence

from rich.console import Console

from hsslam_node import __version__
from hsslam_node.errors import UserError
from hsslam_node.kernels.cache_folder import kernel_cache_folder
from hsslam_services.launch.process_table import environment_of_threads
from hsslam_services.launch.warm_up import warm_up

WARM_UP_HELP = """usage: hsslam-serve warm-up

Compiles all kernels for this machine into the cache (about a minute) and makes the textures of the
built-in room. Does nothing if both exist.

Exit codes: 0 if the kernels are compiled, 1 if it is interrupted, 2 if the input is bad."""


def warm_up_command(args: Sequence[str]) -> int:
    """Run the command; returns the exit code.

    Raises:
        UserError: there is an argument, or the cache folder cannot be written.
    """
    if args and args[0] in ("-h", "--help"):
        print(WARM_UP_HELP)
        return 0
    if args and args[0] == "--version":
        print(f"hsslam-serve {__version__}")
        return 0
    if args:
        raise UserError(f"warm-up {args[0]}: expected no arguments")
    os.environ.update(environment_of_threads(1))
    console = Console(stderr=True, highlight=False)
    start = time.monotonic()
    with console.status("compiling kernels") as status:

        def report(part: str) -> None:
            line = f"compiling kernels, {time.monotonic() - start:.0f} s: {part}"
            status.update(line)
            if not console.is_terminal:
                console.print(line, soft_wrap=True)

        compiled = warm_up(report)
    took = f"compiled in {time.monotonic() - start:.0f} s" if compiled else "compiled before"
    print(f"kernels {took}: {kernel_cache_folder()}")
    return 0
