"""`hsslam-serve`: the command that runs everything."""

import sys


def main() -> None:
    """Parse the command line, run, exit: 0 done, 1 failed, 2 bad input (told in one line)."""
    try:
        sys.exit(_serve())
    except BrokenPipeError:  # whoever read our output is gone
        sys.exit(1)
    except KeyboardInterrupt:  # before there was anything to save
        sys.exit(0)


def _serve() -> int:
    from hsslam_node.errors import UserError

    try:
        if sys.argv[1:2] == ["warm-up"]:
            from hsslam_node.services.warm_up_command import warm_up_command

            return warm_up_command(sys.argv[2:])
        from hsslam_node.services.command_line import parse_command_line
        from hsslam_node.services.supervisor import Supervisor

        return Supervisor(parse_command_line(sys.argv[1:])).run()
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    main()
