"""`hsslam-serve`: runs the service; apart from the supervisor, so that an early Ctrl-C is quiet."""

import sys


def main() -> None:
    """Run the command; exit code 0 if the run is complete, 1 if it failed, 2 on bad input."""
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

        options = parse_command_line(sys.argv[1:])
        from hsslam_services.supervisor.supervisor import Supervisor  # --help is quicker without

        return Supervisor(options).run()
    except KeyboardInterrupt:  # before there was anything to save
        return 0


if __name__ == "__main__":
    main()
