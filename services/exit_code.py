"""How every command ends: what went wrong is one line on stderr, and a code."""

import sys
from collections.abc import Callable

from hsslam_node.errors import UserError


def exit_code(command: Callable[[], int | None]) -> int:
    """The command's own code, 0 where it has none; 1: interrupted, or nobody reads its output any more;
    2: bad input."""
    try:
        return command() or 0
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 1
    except BrokenPipeError:
        return 1
