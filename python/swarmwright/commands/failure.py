"""Why an evaluation by a command has failed."""


class CommandFailure(Exception):  # noqa: N818 - it is the reason of a failed evaluation
    """An episode has failed; the message is a line, without the program's output."""
