"""`hsslam-batch`: the logs below a folder, each a run of its own, planned, run, counted, compared."""

import importlib
import sys
from collections.abc import Sequence

from hsslam_node import __version__
from hsslam_node.errors import UserError, did_you_mean
from hsslam_services.commands.cli import exit_code

_COMMANDS = {  # name: module and function, what it does
    "plan": ("hsslam_batch.plan.command:plan_command", "lists logs and fixes their options"),
    "run": ("hsslam_batch.cluster.command:run_command", "runs all logs that are left, on Ray"),
    "work": ("hsslam_batch.attempt.command:work_command", "runs one log, without Ray"),
    "report": ("hsslam_batch.results.report:report_command", "sums, worst logs, what changed"),
    "status": ("hsslam_batch.results.status:status_command", "counts done, failed and left"),
}
_PURPOSE = "Processes the logs below a folder, each with hsslam-serve in lockstep."
_PARTS = {"ray", "pyarrow", "fsspec"}  # packages of the extra


def main() -> int:
    """Run the command; its exit code."""
    return exit_code(lambda: _batch(sys.argv[1:]))


def _batch(args: Sequence[str]) -> int | None:
    name, rest = (args[0] if args else "--help"), args[1:]
    if name == "--version":
        print(f"hsslam-batch {__version__}")
    elif name in ("-h", "--help"):
        print(f"usage: hsslam-batch {'|'.join(_COMMANDS)} ...\n\n{_PURPOSE}")
        for command, (_, what) in _COMMANDS.items():
            print(f"  hsslam-batch {command:<8}{what}")
        print("\nEach command has its own --help.")
    elif name in _COMMANDS:
        module, _, function = _COMMANDS[name][0].partition(":")
        try:
            return getattr(importlib.import_module(module), function)(rest)
        except ModuleNotFoundError as error:
            if error.name not in _PARTS:
                raise
            wanted = "pip install 'hsslam-node[batch]'"
            raise UserError(f"{name}: package {error.name} is missing: expected {wanted}") from None
    else:
        known = list(_COMMANDS)
        raise UserError(f"{name}: expected {', '.join(known)}{did_you_mean(name, known)}")
    return None


if __name__ == "__main__":
    sys.exit(main())
