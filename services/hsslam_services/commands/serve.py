"""`hsslam-serve`: the command that runs everything."""

import sys


def main() -> None:
    """Parse the command line, run, exit: 0 done, 1 failed, 2 bad input (told in one line)."""
    try:
        from hsslam_services.commands.cli import exit_code

        sys.exit(exit_code(_serve))
    except KeyboardInterrupt:  # while Python starts
        sys.exit(0)


def _serve() -> int:
    try:
        if sys.argv[1:2] == ["warm-up"]:
            from hsslam_services.commands.warm_up import warm_up_command

            return warm_up_command(sys.argv[2:])
        from hsslam_services.commands.serve_command_line import parse_command_line
        from hsslam_services.supervisor.supervisor import Supervisor

        return Supervisor(parse_command_line(sys.argv[1:])).run()
    except KeyboardInterrupt:  # before there was anything to save
        return 0


if __name__ == "__main__":
    main()
