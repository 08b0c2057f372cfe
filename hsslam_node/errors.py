"""The one exception whose text is meant for the user."""


class UserError(Exception):
    """Bad input, told in one line: what (file, topic, field or option), its value, what was expected.

    Command-line entry points print the message without a traceback and exit with code 2.
    """


class OutOfMemoryError(UserError):
    """The memory that a run needs is not there; unlike other bad input it cannot be skipped."""
