"""`hsslam-batch`: plans, runs, counts and compares the runs of all logs below a folder."""

import sys
from collections.abc import Sequence

from hsslam_node.errors import UserError
from hsslam_services.commands.cli import Subcommand, exit_code, run_subcommand

_PROG = "hsslam-batch"
_PURPOSE = "Processes the logs below a folder, each with hsslam-serve in lockstep."
_PARTS = {"ray", "pyarrow", "fsspec"}  # packages of the extra


def main() -> int:
    """Run the command; its exit code."""
    return exit_code(lambda: _batch(sys.argv[1:]), hears_signals=False)


def _batch(args: Sequence[str]) -> int | None:
    try:
        return run_subcommand(_PROG, _PURPOSE, _COMMANDS, args, exit_codes="")
    except ModuleNotFoundError as error:
        if error.name not in _PARTS:
            raise
        wanted = "pip install 'hsslam-node[batch]'"
        raise UserError(f"{args[0]}: package {error.name} is missing: expected {wanted}") from None


def _plan(args: Sequence[str]) -> None:
    from hsslam_batch.plan.command import plan_command

    plan_command(args)


def _run(args: Sequence[str]) -> int:
    from hsslam_batch.cluster.command import run_command

    return run_command(args)


def _work(args: Sequence[str]) -> int:
    from hsslam_batch.attempt.command import work_command

    return work_command(args)


def _report(args: Sequence[str]) -> int:
    from hsslam_batch.results.report import report_command

    return report_command(args)


def _status(args: Sequence[str]) -> int:
    from hsslam_batch.results.status import status_command

    return status_command(args)


_COMMANDS: dict[str, tuple[Subcommand, str]] = {
    "plan": (_plan, "lists logs and fixes their options"),
    "run": (_run, "runs all logs that are left, on Ray"),
    "work": (_work, "runs one log, without Ray"),
    "report": (_report, "shows sums, worst logs, what changed"),
    "status": (_status, "counts done, failed and left"),
}


if __name__ == "__main__":
    sys.exit(main())
