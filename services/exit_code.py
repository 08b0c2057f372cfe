"""How every command ends: what went wrong is one line on stderr, and a code."""

import os
import sys
from collections.abc import Callable

from hsslam_node.errors import UserError


def exit_code(command: Callable[[], int | None]) -> int:
    """The command's own code, 0 where it has none; 1: interrupted, or nobody reads its output any more;
    2: bad input."""
    try:
        try:
            return command() or 0
        finally:
            sys.stdout.flush()
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    except BrokenPipeError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # for what is flushed at the end
        return 1
